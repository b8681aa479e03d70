"""The public list against reality, and values that show themselves."""

from __future__ import annotations

import ast
import base64
import dataclasses
import inspect
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.cli.argument_flags import replace_arguments_by_options
from printer_slicer.drawing.canvas import Text, estimate_text_width
from printer_slicer.version import VERSION
from tests.api.example import run
from tests.parts import box, cone
from tests.sources import PACKAGE, SOURCES, trees
from tests.waiting import LAST_RESORT

ROOT: Final = Path(__file__).parents[2]
BOX: Final = box()
SMALL: Final = box((5.0, 5.0, 1.0))
SVG: Final = "{http://www.w3.org/2000/svg}"
PROFILE: Final = ps.load_profile("marlin_220", "pla", "adaptive")
STAGES: Final = ps.slice_stages(cone(8, 3, 6), PROFILE)
FUNCTIONS: Final = [name for name in ps.__all__ if inspect.isfunction(getattr(ps, name))]
CLASSES: Final = [name for name in ps.__all__ if inspect.isclass(getattr(ps, name))]
DRAWN: Final = ("plan", "sections", "walls", "regions", "toolpaths", "program")


def attributes_of(kind: Any) -> list[str]:
    """The attributes that a class's docstring tells of."""
    text = inspect.getdoc(kind) or ""
    lines = text.partition("Attributes:\n")[2].splitlines()
    own = [line for line in lines if line.startswith("    ") and not line.startswith("     ") and ":" in line]
    return [name.strip() for line in own for name in line.partition(":")[0].split(",")]


def test_every_public_name_exists_and_nothing_else_is_public() -> None:
    there = {name for name in vars(ps) if not name.startswith("_")}
    modules = {name for name in there if inspect.ismodule(getattr(ps, name))}

    assert [name for name in ps.__all__ if not hasattr(ps, name)] == []
    assert there - modules - set(ps.__all__) - {"TYPE_CHECKING", "annotations", "import_module"} == set()
    assert set(dir(ps)) == set(ps.__all__)


def test_the_public_list_is_small() -> None:
    assert len(ps.__all__) <= 68


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_public_function_tells_of_each_argument_and_is_typed(name: str) -> None:
    function = getattr(ps, name)
    text, signature = inspect.getdoc(function) or "", inspect.signature(function)
    unsaid = [one for one in signature.parameters if f"{one}:" not in text and f"`{one}`" not in text]
    typed = [one.annotation for one in signature.parameters.values()]

    # One argument in one sentence needs no list; one function may refer to another.
    assert text
    assert unsaid == [] or len(signature.parameters) == 1 or "arguments" in text, unsaid
    assert inspect.Parameter.empty not in typed
    assert signature.return_annotation is not inspect.Signature.empty


@pytest.mark.parametrize("name", CLASSES)
def test_every_public_value_tells_of_each_attribute(name: str) -> None:
    kind = getattr(ps, name)
    fields = [field.name for field in dataclasses.fields(kind)] if dataclasses.is_dataclass(kind) else []

    assert inspect.getdoc(kind)
    assert set(fields) - set(attributes_of(kind)) - {"layer_heights"} == set()


def test_the_reference_lists_all_public_names_and_only_these() -> None:
    text = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    told = re.findall(r"(?m)^\.\. (?:auto)?(function|class|data|exception):: printer_slicer\.(\w+)$", text)

    assert sorted(name for _, name in told) == sorted(ps.__all__)
    assert [
        name for kind, name in told if (kind == "function") != inspect.isfunction(getattr(ps, name))
    ] == []


def test_the_package_is_typed_and_an_example_passes_mypy_strict() -> None:
    example = ROOT / "tests" / "api" / "example.py"
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", str(example)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=LAST_RESORT,
        check=False,
    )

    assert done.returncode == 0, done.stdout + done.stderr
    assert (ROOT / "printer_slicer" / "py.typed").is_file()


def test_the_example_runs(tmp_path: Path) -> None:
    verdict = run(ROOT / "sample_parts" / "box.stl", tmp_path)

    assert verdict.ok
    assert (tmp_path / "part.gcode").read_text().startswith("; made by me\n")
    assert (tmp_path / "told.txt").read_text().startswith("32 layers, ")


# One call from a file to a job


def test_slice_makes_the_job_of_a_file_with_a_printer_by_its_display_name() -> None:
    job = ps.slice(ROOT / "sample_parts" / "box.stl", printer="Ender 3", material="petg", quality="standard")
    profile = ps.load_profile("creality_ender3", "petg", "standard")

    assert job.profile == profile
    assert job.text == ps.job_from(ROOT / "sample_parts" / "box.stl", profile).text
    assert ps.dry_run(job).ok


@pytest.mark.parametrize(
    ("given", "ours"),
    [
        ({"perimeters": 3}, {"perimeters": 3}),
        ({"infill_density": "20%"}, {"infill_density": 0.2}),
        ({"layer_height": 0.2}, {"planner.kind": "uniform", "layer_height": 0.2}),
        ({"planner": "uniform"}, {"planner.kind": "uniform"}),
        (
            {"planner": {"kind": "cusp", "metric": "triangle"}},
            {"planner.kind": "cusp", "planner.metric": "triangle"},
        ),
        ({"speeds": {"travel": 120}}, {"quality.speeds.travel": 120}),
        ({"speeds__travel": 120, "printer__bed_x": 210}, {"speeds.travel": 120, "printer.bed_x": 210}),
        ({"quality": "draft", "fill_density": "20%"}, {"infill_density": 0.2}),
        ({"wall_loops": 4}, {"perimeters": 4}),
        ({"infill_sparse_density": 30}, {"infill_density": 0.3}),
        ({"support_material": False}, {}),
        (
            {"walls": 3, "infill": "20%", "brim": 4, "first_layer": 0.3},
            {"perimeters": 3, "infill_density": 0.2, "brim_width": 4, "first_layer_height": 0.3},
        ),
        ({"infill": 20, "brim": True}, {"infill_density": 0.2, "brim_width": 5}),
        ({"infill": "grid", "brim": False}, {"infill": "grid", "brim_width": 0}),
        ({"layer_height": 0.1, "top_solid_layers": 5}, {"layer_height": 0.1, "top_thickness": 0.5}),
    ],
    ids=str,
)
def test_slice_takes_settings_by_familiar_names(given: dict[str, Any], ours: dict[str, object]) -> None:
    job = ps.slice(SMALL, **given)

    assert job.profile == ps.load_profile(quality=given.get("quality"), changes=ours)


def test_a_job_tells_what_settings_of_other_slicers_became() -> None:
    job = ps.slice(BOX, fill_density="20%", wall_loops=4, layer_height=0.2)

    assert job.notes == (
        "PrusaSlicer's fill_density='20%' sets quality.infill_density=0.2",
        "OrcaSlicer's wall_loops=4 sets quality.perimeters=4",
    )
    assert all(note in repr(job) for note in job.notes)
    assert ps.slice(BOX).notes == ()


def test_remedies_about_settings_work_in_python() -> None:
    for give in (lambda: ps.slice(BOX, zebra=1), lambda: ps.load_profile(changes={"zebra": 1})):
        with pytest.raises(ps.PrinterSlicerError) as caught:
            give()
        assert "`ps.find_settings()` lists all" in caught.value.remedy
        assert "`printer-slicer profiles settings` lists all" in replace_arguments_by_options(
            caught.value.remedy
        )

    assert "quality.perimeters" in [row.key for row in ps.find_settings()]
    assert "quality.infill_density" in [row.key for row in ps.find_settings("Infill", "density")]


def test_none_is_no_value_of_a_setting() -> None:
    for give in (
        lambda: ps.slice(BOX, layer_height=None),
        lambda: ps.load_profile(changes={"layer_height": None}),
        lambda: ps.profile_with(PROFILE, {"layer_height": None}),
    ):
        with pytest.raises(ps.PrinterSlicerError, match="layer_height: None is not a value") as caught:
            give()
        assert "Omit the setting" in caught.value.remedy


def test_the_package_has_a_version() -> None:
    assert ps.__version__ == VERSION


def test_a_profile_takes_changes_by_familiar_names() -> None:
    profile = ps.load_profile(changes={"fill_density": "20%", "perimeters": 3})

    assert profile == ps.load_profile(changes={"infill_density": 0.2, "perimeters": 3})
    assert ps.profile_with(profile, {"wall_loops": 4}) == ps.profile_with(profile, {"perimeters": 4})


@pytest.mark.parametrize(
    ("given", "said", "remedy"),
    [
        ({"travel_speed": "50%"}, "travel_speed takes no percentage", "without %"),
        ({"shells": 3}, "shells=3: no such setting", "Did you mean perimeters=3?"),
        ({"walls": 3, "perimeters": 4}, "walls and perimeters are the same setting", "Remove one"),
        ({"copies": 4}, "copies=4: no such setting", "ps.join"),
        ({"scale": 2}, "scale=2: no such setting", "ps.transform"),
        ({"load": "config.ini"}, "load='config.ini': no such setting", "profiles import"),
        ({"printer": PROFILE}, "printer: expected the name of a profile", "ps.job_of(mesh, profile)"),
        ({"profile": PROFILE}, "profile: expected the name of a profile", "ps.job_of(mesh, profile)"),
        ({"profile": "standard"}, "profile='standard': no such setting", "printer=NAME"),
        ({"material": 3}, "the argument `material` must be", 'such as "petg"'),
        ({"supports": True}, "supports=True: no such setting", "Did you mean support='auto'?"),
        ({"speed": 50}, "speed=50: no such setting", "Did you mean speeds__perimeter=50?"),
        ({"infill_percentage": 20}, "no such setting", "Did you mean infill_density='20%'?"),
        ({"perimetres": 3}, "perimetres: no such setting", "Did you mean 'perimeters'?"),
        ({"printer": "no such machine"}, "unknown printer", "lists all"),
        ({"profiles": ["no such folder"], "printer": "mine"}, "unknown printer 'mine'", "lists all"),
    ],
    ids=str,
)
def test_slice_says_what_an_unknown_argument_means(given: dict[str, Any], said: str, remedy: str) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=said) as caught:
        ps.slice(BOX, **given)

    assert remedy in caught.value.remedy
    assert "--" not in str(caught.value)


@pytest.mark.parametrize(
    ("given", "said", "remedy"),
    [
        ("part.gcode", "already sliced", "ps.job_from"),
        (7, "must be a file name or a Mesh", "ps.slice"),
        ("missing.stl", "missing.stl: no such file", "Check the name"),
    ],
)
def test_slice_rejects_what_is_no_model(given: Any, said: str, remedy: str) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=said) as caught:
        ps.slice(given)

    assert remedy in caught.value.remedy


def test_the_remedy_for_several_copies_works() -> None:
    copies = ps.join([BOX, BOX.moved((30, 0, 0))])

    assert len(ps.slice(copies).plan.top) == len(ps.slice(BOX).plan.top)  # type: ignore[union-attr]


def test_a_misspelt_option_of_slice_part_is_named_with_the_options() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="choices: slice_part has no such argument") as caught:
        ps.slice_part(BOX, PROFILE, choices=None)  # type: ignore[call-arg]

    assert "strategies" in caught.value.remedy


def test_dry_run_and_check_read_files(tmp_path: Path) -> None:
    path, other, model = tmp_path / "box.gcode", tmp_path / "other.gcode", tmp_path / "box.stl"
    job = ps.slice(BOX, printer="Ender 3")
    job.save(path)
    ps.export_stl(BOX, model)
    other.write_text("G28\nG1 X5\n")

    assert ps.dry_run(path).ok
    assert ps.dry_run(path).total_seconds == ps.dry_run(job).total_seconds
    assert ps.dry_run(str(other), PROFILE).job == "other.gcode"
    assert ps.check_gcode(path, model).ok
    assert ps.check_gcode(str(path), BOX).name == "box.gcode"
    for given, said, remedy in (
        (other, "contains no settings", "ps.load_profile"),
        ("part.stl", "is not G-code", "ps.slice"),
        ("missing.gcode", "no such file", "Check the path"),
    ):
        with pytest.raises(ps.PrinterSlicerError, match=said) as caught:
            ps.dry_run(given)
        assert remedy in caught.value.remedy


def test_a_job_is_printed_with_its_own_profile() -> None:
    job = ps.slice(BOX)
    without = dataclasses.replace(job, profile=None)

    with pytest.raises(ps.PrinterSlicerError, match="there is no port"):
        ps.print_job(job, None, "/dev/missing")
    for call in (lambda: ps.dry_run(without), lambda: ps.print_job(without, None, "/dev/missing")):
        with pytest.raises(ps.PrinterSlicerError, match="the job has no profile"):
            call()


# Values in a notebook


def test_a_profile_is_a_table_with_the_changes_first() -> None:
    changes = {"perimeters": 3, "speeds.travel": 120, "infill_density": 0.25}
    profile = ps.load_profile("Ender 3", "petg", "standard", changes)
    root = ET.fromstring(f"<div>{profile._repr_html_()}</div>")
    rows = [[cell.text or "" for cell in row] for row in root.iter("tr")]

    assert (root.findtext("p") or "").endswith("quality standard; 3 settings changed")
    assert rows[:5] == [
        ["setting", "value", "default"],
        ["changed"],
        ["quality.perimeters", "3", "2"],
        ["quality.infill_density", "25%", "15%"],
        ["quality.speeds.travel", "120 mm/s", "0 mm/s"],
    ]
    assert ["set by the quality profile"] in rows
    assert ["quality.planner.kind", "uniform", "optimal"] in rows
    assert ["printer.bed_x", "220 mm", ""] in rows
    assert not [row for row in rows if "first_layer_speed" in row or row[0].endswith(".name")]
    assert len(rows) <= 30


def test_a_profile_says_in_lines_what_was_changed_and_what_its_profiles_set() -> None:
    lines = repr(ps.load_profile("Ender 3", "petg", changes={"perimeters": 3})).splitlines()

    assert (
        lines[0] == "<Profile: printer Creality Ender-3, material PETG, quality adaptive; 1 setting changed"
    )
    assert lines[1] == "  changed:"
    assert lines[2].split() == ["quality.perimeters", "3", "(default", "2)"]
    assert [line.strip() for line in lines if line.endswith(":")][1:] == [
        f"set by the {kind} profile:" for kind in ("quality", "material", "printer")
    ]
    assert lines[-1] == ">"
    assert len(lines) <= 27
    assert max(map(len, lines)) <= 120


def test_a_profile_as_named_has_no_changes() -> None:
    default = ps.load_profile()

    assert "; nothing changed\n" in repr(default)
    assert "material.fan_ratio              60%  (default 50%)" in repr(default)
    assert default.changed == ()


def test_a_profile_knows_what_was_changed_but_its_equality_does_not() -> None:
    changed = ps.profile_with(ps.load_profile(changes={"perimeters": 3}), {"seam": "rear"})
    back = ps.profile_with(ps.profile_with(PROFILE, {"perimeters": 9}), {"perimeters": 2})

    assert changed.changed == ("quality.perimeters", "quality.seam")
    assert back == PROFILE
    assert hash(back) == hash(PROFILE)
    assert back.changed == ("quality.perimeters",)


@pytest.mark.parametrize("name", DRAWN)
def test_values_draw_themselves(name: str) -> None:
    value = getattr(STAGES, name)
    root = ET.fromstring(value._repr_svg_())
    said = " ".join(node.text or "" for node in root.iter(f"{SVG}text"))

    assert root.tag == f"{SVG}svg"
    assert f"{STAGES.plan.n_layers} layers" in said
    assert list(root.iter(f"{SVG}path")) + list(root.iter(f"{SVG}rect"))[1:] != []


@pytest.mark.parametrize("name", DRAWN[1:])
def test_one_layer_is_drawn_at_its_place(name: str) -> None:
    value = getattr(STAGES, name)
    picture = ps.draw(value, 4)

    assert f"layer 4, z {STAGES.plan.top[3]:.4g} mm" in picture.title
    with pytest.raises(
        ps.PrinterSlicerError, match=f"layer {STAGES.plan.n_layers + 1} does not exist"
    ) as caught:
        ps.draw(value, STAGES.plan.n_layers + 1)
    assert caught.value.remedy == f"Choose a layer from 1 to {STAGES.plan.n_layers}"


def test_a_mesh_is_seen_as_it_stands() -> None:
    root = ET.fromstring(STAGES.part._repr_svg_())
    (image,) = root.iter(f"{SVG}image")
    data = base64.b64decode(image.attrib["href"].partition(",")[2])

    assert data.startswith(b"\x89PNG")
    assert "without facets" in ps.draw(ps.Mesh(np.zeros((0, 3, 3))))._repr_svg_()
    assert ps.draw(STAGES.part).png().startswith(b"\x89PNG")


def test_a_certificate_has_a_bar_for_every_layer_as_long_as_its_bound() -> None:
    certificate = ps.certify(ps.read_surface(STAGES.part), STAGES.plan)
    bars = [
        shape.width  # type: ignore[union-attr]
        for shape in ps.draw(certificate).shapes
        if getattr(shape, "name", "") == "layer"
    ]

    np.testing.assert_allclose(np.array(bars) / max(bars), certificate.bound / certificate.bound.max())


def test_all_stages_and_their_job_show_the_moves(tmp_path: Path) -> None:
    job = ps.job_of(STAGES, PROFILE)
    job.save(tmp_path / "part.gcode")
    read = ps.job_from(tmp_path / "part.gcode", PROFILE)

    assert STAGES._repr_svg_() == job._repr_svg_() == STAGES.program._repr_svg_()
    assert f"extrusions at {len(job.heights)} heights" in read._repr_svg_()


@pytest.mark.parametrize("size", [(2, 150, 3), (200, 3, 2), (2, 2, 3)], ids=str)
def test_all_texts_fit_into_their_pictures(size: tuple[float, float, float]) -> None:
    name = (
        "a name of a part that somebody exported from a program that likes long names, version 2, final.stl"
    )
    stages = ps.slice_stages(ps.Mesh(box(size).triangles, name), PROFILE)
    job = dataclasses.replace(ps.job_of(stages, PROFILE), program=None)
    certificate = ps.certify(ps.read_surface(stages.part), stages.plan)
    values = [stages.part, certificate, job, *(getattr(stages, name) for name in DRAWN)]
    pictures = [ps.draw(value, layer) for value in values for layer in (None, 2)]

    assert [
        (text.text, right) for one in pictures for text, right in right_ends(one) if right > one.width
    ] == []


def right_ends(picture: ps.Picture) -> list[tuple[Text, float]]:
    """The texts of a picture, and where each ends, px."""
    texts = [shape for shape in picture.shapes if isinstance(shape, Text)]
    share = {"start": 1.0, "middle": 0.5, "end": 0.0}
    return [
        (one, one.x + share[one.anchor] * estimate_text_width(one.text, one.size, bold=one.bold))
        for one in texts
    ]


def test_the_worst_layer_of_a_certificate_is_counted_from_1() -> None:
    certificate = ps.certify(ps.read_surface(STAGES.part), STAGES.plan)

    assert certificate.worst.layer == int(certificate.bound.argmax()) + 1


def test_a_section_is_drawn_as_large_as_it_is() -> None:
    """The radius of the cone's section, from the picture's own scale."""
    picture = ps.draw(STAGES.sections, 1)
    rings = [shape for shape in picture.shapes if type(shape).__name__ == "Line"]
    spans = np.ptp(rings[0].points, axis=0)  # type: ignore[union-attr]
    x, y = np.ptp(STAGES.sections.solid.ring(0), axis=0)

    assert spans[0] / spans[1] == pytest.approx(x / y, rel=1e-6)
    assert spans.max() == pytest.approx(560 * max(x, y) / (max(x, y) + 2), rel=1e-6)


def test_the_plan_has_a_bar_for_every_layer() -> None:
    bars = [shape for shape in ps.draw(STAGES.plan).shapes if getattr(shape, "name", "") == "layer"]

    assert len(bars) == STAGES.plan.n_layers


def test_values_without_anything_in_them_have_a_picture_too() -> None:
    empty = ps.Areas.empty(3)

    assert "nothing there" in ps.draw(empty)._repr_svg_()
    assert "nothing there" in ps.draw(empty, 1)._repr_svg_()
    assert "without layers" in ps.draw(ps.LayerPlan.from_tops(np.zeros(0)))._repr_svg_()


def test_a_verdict_is_a_card_that_tells_what_is_wrong() -> None:
    job = ps.job_of(STAGES, PROFILE)
    good = ps.dry_run(job, PROFILE)
    bad = dataclasses.replace(good, problems=tuple(f"problem {k} {'x' * 200}" for k in range(12)))
    shown = [ET.fromstring(verdict._repr_svg_()) for verdict in (good, bad)]
    said = [" | ".join(node.text or "" for node in root.iter(f"{SVG}text")) for root in shown]

    assert said[0].startswith("cone: no problems | executed | ")
    assert f"{good.commands} of {good.commands} commands, in order" in said[0]
    assert said[1].startswith("cone: do not print, 12 errors")
    assert said[1].count("problem ") == 8
    assert said[1].endswith("and 4 more")
    assert repr(good) == f"<Verdict 'cone': ok, {good.commands} of {good.commands} commands>"


def test_what_has_no_picture_is_refused() -> None:
    for value in (7, STAGES.travels):
        with pytest.raises(ps.PrinterSlicerError, match=r"cannot draw a value of type (int|Travels)"):
            ps.draw(value)


@pytest.mark.parametrize(
    ("give", "said"),
    [
        (lambda: ps.slice_stages("box.stl", PROFILE), "`mesh` must be a Mesh, not a value of type str"),  # type: ignore[arg-type]
        (lambda: ps.slice_stages(BOX, "pla"), "`profile` must be a Profile, not a value of type str"),  # type: ignore[arg-type]
        (lambda: ps.slice_stages(ps.Mesh(np.zeros((0, 3, 3))), PROFILE), "has no facets"),
        (lambda: ps.slice_stages(ps.Mesh(np.full((4, 3, 3), np.nan)), PROFILE), "is not a finite number"),
        (lambda: ps.slice_stages(ps.Mesh(np.full((4, 3, 3), np.inf)), PROFILE), "is not a finite number"),
        (lambda: ps.load_profile(changes=["pla"]), "a mapping of names to values"),  # type: ignore[arg-type]
        (lambda: ps.LayerPlan.from_tops(np.ones((2, 2))), "tops of layers must be a list of numbers"),
        (lambda: ps.LayerPlan.from_tops("ab"), "tops of layers must be a list of numbers"),  # type: ignore[arg-type]
    ],
)
def test_what_makes_no_sense_is_told_with_a_remedy(give: Callable[[], object], said: str) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=said) as caught:
        give()

    assert caught.value.remedy


WRONG_ARGUMENTS: Final[list[tuple[str, str, Callable[[], object]]]] = [
    ("job", "ps.job_from", lambda: ps.dry_run(7)),  # type: ignore[arg-type]
    ("job", "ps.job_from", lambda: ps.print_job("half.gcode", None, "/dev/x")),  # type: ignore[arg-type]
    ("port", "text", lambda: ps.print_job(ps.job_of(STAGES, PROFILE), None, 7)),  # type: ignore[arg-type]
    ("profile", "ps.load_profile", lambda: ps.dry_run(ps.slice(BOX), "ender3")),  # type: ignore[arg-type]
    ("baud", "whole number", lambda: ps.dry_run(ps.slice(BOX), baud="115200")),  # type: ignore[arg-type]
    ("layer", "whole number", lambda: ps.draw(STAGES, layer="3")),  # type: ignore[arg-type]
    ("printer", "profile.printer", lambda: ps.place(BOX, PROFILE)),  # type: ignore[arg-type]
    ("placement", "ps.Placement", lambda: ps.place(BOX, PROFILE.printer, (1, 2))),  # type: ignore[arg-type]
    ("placement", "ps.Placement", lambda: ps.slice_stages(BOX, PROFILE, placement=3)),  # type: ignore[arg-type]
    ("strategies", "ps.Strategies", lambda: ps.plan_part(BOX, PROFILE, len)),  # type: ignore[arg-type]
    ("scale", "0.5 for 50 %", lambda: ps.transform(BOX, scale="50%")),  # type: ignore[arg-type]
    ("rotate", "three angles", lambda: ps.transform(BOX, rotate=90)),  # type: ignore[arg-type]
    ("rotate", "three angles", lambda: ps.transform(BOX, rotate="90")),  # type: ignore[arg-type]
    ("mesh", "ps.load_mesh", lambda: ps.repair("part.stl")),  # type: ignore[arg-type]
    ("mesh", "ps.load_mesh", lambda: ps.read_surface("part.stl")),  # type: ignore[arg-type]
    ("meshes", "[mesh]", lambda: ps.join(BOX)),  # type: ignore[arg-type]
    ("meshes", "ps.load_mesh", lambda: ps.join(["part.stl"])),  # type: ignore[list-item]
    ("surface", "ps.read_surface", lambda: ps.certify(BOX, STAGES.plan)),  # type: ignore[arg-type]
    ("text", "read_bytes", lambda: ps.check_gcode(7, BOX)),  # type: ignore[arg-type]
    ("program", "stages.program", lambda: ps.gcode_of(STAGES, PROFILE)),  # type: ignore[arg-type]
    ("program", "stages.program", lambda: ps.move_seconds(STAGES, PROFILE)),  # type: ignore[arg-type]
    ("path", "part.stl", lambda: ps.load_mesh(7)),  # type: ignore[arg-type]
    ("path", "part.stl", lambda: ps.export_stl(BOX, 7)),  # type: ignore[arg-type]
    ("printer", "Ender 3", lambda: ps.load_profile(7)),  # type: ignore[arg-type]
    ("printer", "Ender 3", lambda: ps.slice(BOX, printer=7)),  # type: ignore[arg-type]
    ("folders", "list of folders", lambda: ps.slice(BOX, profiles="mine")),
    ("profile", "ps.load_profile", lambda: ps.profile_with("ender3", {})),  # type: ignore[arg-type]
    ("changes", "layer_height", lambda: ps.profile_with(PROFILE, [1])),  # type: ignore[arg-type]
    ("folders", "list of folders", lambda: ps.load_profile(folders="mine")),
    ("sections", "stages.sections", lambda: ps.draw_plan(STAGES, None, "t")),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("argument", "remedy", "call"), WRONG_ARGUMENTS)
def test_an_argument_of_another_type_is_named_with_what_to_pass(
    argument: str, remedy: str, call: Callable[[], object]
) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=rf"{argument}\b.* must be .*not ") as caught:
        call()

    assert remedy in caught.value.remedy
    assert len(str(caught.value).splitlines()) <= 2


def test_files_are_named_by_text_or_paths() -> None:
    path = ROOT / "sample_parts" / "box.stl"

    assert ps.job_from(str(path), PROFILE).text == ps.job_from(path, PROFILE).text
    assert ps.load_profile(ROOT / "profiles" / "printers" / "creality_ender3.toml").printer.name
    assert ps.load_profile("creality_ender3", folders=[str(ROOT / "profiles")]).printer.name


def test_pictures_are_saved_by_name(tmp_path: Path) -> None:
    picture = ps.draw(STAGES.plan)
    picture.save(tmp_path / "plan.svg")
    picture.save(str(tmp_path / "plan.png"))

    assert (tmp_path / "plan.svg").read_text() == picture.svg() == picture._repr_svg_()
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ps.PrinterSlicerError, match="format are not supported"):
        picture.save(tmp_path / "plan.gif")


def test_a_job_is_saved_whole(tmp_path: Path) -> None:
    job = ps.job_of(STAGES, PROFILE)
    job.save(tmp_path / "part.gcode")

    assert (tmp_path / "part.gcode").read_bytes() == job.text
    with pytest.raises(ps.PrinterSlicerError, match=r"the folder .* does not exist"):
        job.save(tmp_path / "missing" / "part.gcode")


def test_a_job_of_stages_is_the_job_of_their_part() -> None:
    assert ps.job_of(STAGES, PROFILE).text == ps.job_of(cone(8, 3, 6), PROFILE).text


def test_values_say_what_they_are() -> None:
    plan = STAGES.plan
    said = {
        repr(STAGES.part): "<Mesh 'cone': ",
        repr(plan): f"<LayerPlan optimal: {plan.n_layers} layers of",
        repr(STAGES.sections): f"<Sections: {plan.n_layers} layers, {plan.n_layers} contours, ",
        repr(STAGES.sections.solid): f"<Areas: {plan.n_layers} layers, ",
        repr(STAGES.walls): f"<Walls: {plan.n_layers} layers, ",
        repr(STAGES.regions): f"<Regions: {plan.n_layers} layers, mm3: bottom_solid_infill ",
        repr(STAGES.toolpaths): f"<Toolpaths: {plan.n_layers} layers, ",
        repr(STAGES.travels): f"<Travels: {STAGES.travels.n_travels} travels, ",
        repr(STAGES.program): f"<Program: {plan.n_layers} layers, {STAGES.program.n_moves} moves, ",
        repr(ps.job_of(STAGES, PROFILE)): f"<Job 'cone': {plan.n_layers} layers, ",
        repr(ps.draw(plan)): "<Picture '",
        repr(ps.LayerPlan.from_tops(np.zeros(0))): "<LayerPlan: no layers>",
        repr(
            ps.Polylines.from_lines([[np.array([(0.0, 0), (3, 4)])]])
        ): "<Polylines: 1 lines, 2 points, 5 mm>",
    }

    assert [text for text, begins in said.items() if not text.startswith(begins)] == []
    assert max(map(len, said)) < 200
    assert repr(STAGES).count("\n") == 8


# Messages for Python


ENGINE: Final = [
    path
    for path in SOURCES
    if path.relative_to(PACKAGE).parts[0]
    # Rooms of the command line, and those that only its commands use.
    not in {
        "cli",
        "doctor.py",
        "importing",
        "print_queue",
        "printing",
        "sending",
        "server",
        "sim",
        "__main__.py",
    }
]


def test_messages_below_the_command_line_name_no_flags() -> None:
    flag = re.compile(r"(?:^|[\s(`'\"])--[a-z]")
    found = []
    for path in ENGINE:
        tree = trees()[path]
        docs = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        found += [
            f"{path.name}:{node.lineno}: {node.value}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and id(node) not in docs and isinstance(node.value, str)
            if flag.search(node.value) and path.name != "document.py"  # documents the command line
        ]

    assert found == []


def test_an_error_from_python_names_an_argument_and_the_command_line_its_flag() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="does not fit") as caught:
        ps.slice(box((2000.0, 20.0, 20.0)))

    assert "`scale=" in caught.value.remedy
    assert replace_arguments_by_options('Use `scale=0.5`, `units="inch"` or `drop=False`') == (
        "Use --scale 0.5, --units inch or --no-drop"
    )
    assert (
        replace_arguments_by_options('see `job.allowing(["box", "cold"])`') == "see --allow box --allow cold"
    )
    assert (
        replace_arguments_by_options("Remove one of these `inherits`; a ` b")
        == "Remove one of these `inherits`; a ` b"
    )
