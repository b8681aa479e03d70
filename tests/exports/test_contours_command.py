"""`contours`: where files go, what is told, what is refused."""

from __future__ import annotations

import io
import json
import re
import struct
from argparse import Namespace
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printer_slicer.cli.commands.contours import run as contours_command
from printer_slicer.cli.parser import build_parser
from printer_slicer.errors import OutputError, PrinterSlicerError, UsageError
from printer_slicer.exports import write_cli, write_slc, write_svg
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.pipeline import plan_part
from printer_slicer.placing import place
from printer_slicer.profile import load_profile
from printer_slicer.slicing import cut
from tests.exports.readers import read_cli, read_slc, read_svg
from tests.parts import box, joined

PARTS = Path(__file__).parents[2] / "sample_parts"
NAMES = ("marlin_220", "pla", "standard")
QUICK = ("--printer", NAMES[0], "--material", NAMES[1], "--quality", NAMES[2], "--set", "layer_height=0.3")


def asked(model: Path, output: object, *flags: str, **own: Any) -> Namespace:
    """The command line with all usual settings, and what is only asked of `contours`."""
    usual = QUICK[:-2] if "--planner" in flags else QUICK  # a height contradicts most planners
    arguments = build_parser().parse_args(["slice", str(model), *usual, *flags])
    arguments.output = str(output)
    vars(arguments).update({"binary": False, "smooth": None, "resample": None, **own})
    return arguments


def done(model: Path, output: object, *flags: str, **own: Any) -> tuple[str, dict[str, Any]]:
    """What it says to people, and as JSON, when it is run for each."""
    said = []
    for kind in ((), ("--json",)):
        with redirect_stdout(io.StringIO()) as out:
            assert contours_command(asked(model, output, *kind, *flags, **own)) == 0
        said.append(out.getvalue())
    return said[0], json.loads(said[1])


def refused(model: Path, output: object, *flags: str, **own: Any) -> PrinterSlicerError:
    """The error."""
    with pytest.raises(PrinterSlicerError) as caught:
        contours_command(asked(model, output, *flags, **own))
    return caught.value


def sections(model: Path) -> Sections:
    """The same part, cut by hand."""
    profile = load_profile(*NAMES, {"layer_height": "0.3"})
    part = place(load_mesh(model), profile.printer)
    return cut(part, plan_part(part, profile), profile.quality.resolution)


def stl(mesh: Mesh, path: Path) -> Path:
    """A mesh as a binary STL file."""
    facets = [struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in mesh.triangles.astype("<f4")]
    path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))
    return path


# Files


@pytest.mark.parametrize("name", ["a.cli", "a.CLI", "a.slc", "a.svg"])
def test_the_suffix_decides_the_format(name: str, tmp_path: Path) -> None:
    model, path = PARTS / "vase.stl", tmp_path / name
    text, facts = done(model, path)
    stack = sections(model)
    wanted = {".cli": lambda: write_cli(stack, binary=False), ".slc": lambda: write_slc(stack)}
    data = path.read_bytes()

    assert data == wanted.get(path.suffix.lower(), lambda: write_svg(stack))()
    assert facts["bytes"] == len(data)
    assert facts["layers"] == stack.plan.n_layers
    assert facts["rings"] == stack.solid.n_rings
    assert facts["points"] == len(stack.solid.xy)
    assert str(path) in text
    assert f"{stack.plan.n_layers} layers" in text


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    """A link that leads nowhere has its name."""
    (tmp_path / "slices").symlink_to("nowhere/at/all")
    error = refused(PARTS / "box.stl", f"{tmp_path}/slices/")

    assert isinstance(error, OutputError)
    assert str(error) == (
        f"{tmp_path}/slices: the folder cannot be created: File exists\n  Check the name and the permissions"
    )


def test_binary_cli_is_asked_for_with_a_flag(tmp_path: Path) -> None:
    path = tmp_path / "a.cli"
    _, facts = done(PARTS / "box.stl", path, binary=True)

    assert "BINARY" in read_cli(path.read_bytes()).header
    assert facts["binary"] is True


@pytest.mark.parametrize("there", [True, False])
def test_a_folder_gets_one_svg_per_layer(there: bool, tmp_path: Path) -> None:
    folder = tmp_path / "slices"
    if there:
        folder.mkdir()
    _, facts = done(PARTS / "box.stl", f"{folder}/")
    files = sorted(folder.iterdir())

    assert len(files) == facts["files"] == facts["layers"]
    assert files[0].name == "layer0000.svg"
    assert sum(file.stat().st_size for file in files) == facts["bytes"]
    z = [read_svg(file.read_bytes())[2][0].z for file in files]
    assert z == sorted(z)


def test_a_pattern_names_the_drawings(tmp_path: Path) -> None:
    _, facts = done(PARTS / "box.stl", tmp_path / "box_%03d.svg")

    assert sorted(file.name for file in tmp_path.iterdir()) == [
        f"box_{layer:03d}.svg" for layer in range(facts["layers"])
    ]


def test_drawings_left_from_a_higher_part_are_mentioned(tmp_path: Path) -> None:
    (tmp_path / "layer9999.svg").write_text("old", encoding="utf-8")
    text, facts = done(PARTS / "box.stl", f"{tmp_path}/")

    assert any("1 layer files" in note for note in facts["notes"])
    assert "1 layer files" in text


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("a.gcode", ".svg, .cli or .slc"),
        ("a", ".svg, .cli or .slc"),
        ("-", ".svg, .cli or .slc"),
        ("a_%d_%d.svg", "once"),
        ("a_%s.svg", "once"),
        ("nowhere/a.cli", "does not exist"),
        ("nowhere/deeper/", "does not exist"),
        ("nowhere/a_%d.svg", "does not exist"),
        ("a_file/", "not a folder"),
        (300 * "a" + ".cli", "cannot be written"),
    ],
)
def test_outputs_that_cannot_be_are_refused_before_slicing(output: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "a_file").write_text("", encoding="utf-8")
    error = refused(tmp_path / "missing.stl", f"{tmp_path}/{output}" if output != "-" else output)

    assert isinstance(error, UsageError | OutputError)
    assert words in str(error)
    assert error.remedy


@pytest.mark.parametrize("output", ["a.slc", "a.svg", "slices/"])
def test_only_cli_has_two_kinds(output: str, tmp_path: Path) -> None:
    assert "only .cli" in str(refused(PARTS / "box.stl", f"{tmp_path}/{output}", binary=True))


def test_the_model_is_never_written_over(tmp_path: Path) -> None:
    model = stl(box(), tmp_path / "part.stl")
    (tmp_path / "part.slc").symlink_to(model)

    assert "is an input file" in str(refused(model, tmp_path / "part.slc"))


# Shapes


def test_smoothing_and_resampling_are_told_with_their_bounds(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    text, facts = done(PARTS / "box.stl", path, smooth=0.05, resample=1.0)
    off = facts["at_most_off"]

    assert off["smoothed"] == 0.05
    assert off["resampled"] == off["simplified"] == 0.0125
    assert 0 < off["rounded"] <= 0.0005 * np.sqrt(2) + 1e-9
    assert off["together"] == pytest.approx(0.075 + off["rounded"])
    assert facts["spacing"] == 1.0
    assert "smoothed 0.05" in text
    assert "mm apart" in text
    assert facts["farthest_apart"] <= 1.0 + 0.0015


@pytest.mark.parametrize(
    ("name", "binary"), [("a.svg", False), ("a.cli", False), ("a.cli", True), ("a.slc", False)]
)
def test_how_far_apart_points_are_is_true_of_the_numbers_in_the_file(
    name: str, binary: bool, tmp_path: Path
) -> None:
    path = tmp_path / name
    text, facts = done(PARTS / "vase.stl", path, resample=0.7, binary=binary)
    farthest = 0.0
    for ring in rings_in(path):
        farthest = max(farthest, float(np.hypot(*(np.roll(ring, -1, axis=0) - ring).T).max()))
    (told,) = re.findall(r"points in the file are at most ([\d.]+) mm apart", text)

    assert facts["farthest_apart"] == pytest.approx(farthest, abs=1e-8)
    assert farthest - 1e-8 <= float(told) < farthest + 1e-4
    assert 0.69 < farthest <= 0.7 + 0.0015


def rings_in(path: Path) -> list[np.ndarray]:
    """All contours of a file."""
    data = path.read_bytes()
    if path.suffix == ".svg":
        return [ring for layer in read_svg(data)[2] for ring in layer.rings]
    file = read_cli(data) if path.suffix == ".cli" else None
    if file:
        return [points for _, polylines in file.layers for _, points in polylines]
    return [points for _, polylines in read_slc(data).layers for points in polylines]


def test_without_flags_nothing_is_smoothed_and_only_the_rounding_is_told(tmp_path: Path) -> None:
    text, facts = done(PARTS / "box.stl", tmp_path / "a.slc")

    assert facts["at_most_off"]["smoothed"] == facts["at_most_off"]["resampled"] == 0
    assert facts["rounding"] <= 8e-6
    assert facts["spacing"] is None
    assert "apart" not in text


def test_points_may_be_left_out_without_putting_any_in(tmp_path: Path) -> None:
    _, plain = done(PARTS / "vase.stl", tmp_path / "a.cli")
    text, facts = done(PARTS / "vase.stl", tmp_path / "a.cli", resample=float("inf"))

    assert facts["points"] < plain["points"]
    assert facts["spacing"] is None
    assert "resampled 0.0125" in text
    assert "apart" not in text


@pytest.mark.parametrize(("flag", "value"), [("smooth", 0.05), ("resample", 1.0)])
def test_contours_that_must_not_cross_the_surface_are_not_moved(
    flag: str, value: float, tmp_path: Path
) -> None:
    error = refused(PARTS / "box.stl", tmp_path / "a.cli", "--containment", "positive", **{flag: value})

    assert f"--{flag}" in str(error)
    assert "positive" in str(error)


def test_contained_contours_are_written_and_what_rounding_does_to_them_is_told(tmp_path: Path) -> None:
    _, facts = done(PARTS / "box.stl", tmp_path / "a.cli", "--containment", "negative")

    assert any("negative containment" in note for note in facts["notes"])


@pytest.mark.parametrize("values", [{"smooth": 0.0}, {"smooth": -1.0}, {"resample": 0.0}])
def test_shapes_that_make_no_sense_are_refused(values: dict[str, float], tmp_path: Path) -> None:
    assert isinstance(refused(PARTS / "box.stl", tmp_path / "a.cli", **values), UsageError)
    assert list(tmp_path.iterdir()) == []


# What is told


def test_the_bounds_are_those_of_the_contours(tmp_path: Path) -> None:
    _, facts = done(PARTS / "box.stl", tmp_path / "a.cli")
    (x0, y0, z0), (x1, y1, z1) = facts["bounds"]
    dimension = read_cli((tmp_path / "a.cli").read_bytes()).header["DIMENSION"]

    np.testing.assert_allclose(
        [float(n) for n in dimension.split(",")], [x0, y0, z0, x1, y1, z1], atol=0.0006
    )


def test_heights_that_slc_readers_may_not_like_are_mentioned(tmp_path: Path) -> None:
    path = tmp_path / "a.slc"
    _, facts = done(PARTS / "box.stl", path, "--set", "first_layer_height=0.2")

    assert any("multiples" in note for note in facts["notes"])
    assert len(read_slc(path.read_bytes()).table) == len(facts["heights"]) > 1


def test_empty_layers_are_told(tmp_path: Path) -> None:
    model = stl(joined([box((10, 10, 1)), box((10, 10, 1), (0, 0, 3))]), tmp_path / "two.stl")
    text, facts = done(model, tmp_path / "a.cli")
    empty = sum(not polylines for _, polylines in read_cli((tmp_path / "a.cli").read_bytes()).layers[1:])

    assert facts["empty_layers"] == empty > 1
    assert f"{empty} layers are empty" in text


def test_rings_too_small_for_the_rounding_are_told(tmp_path: Path) -> None:
    model = stl(joined([box(), box((0.0003, 0.0003, 10), (15, 0, 0))]), tmp_path / "dust.stl")
    text, facts = done(model, tmp_path / "a.cli", "--set", "resolution=0")

    assert facts["rings_left_out"] == facts["layers"]
    assert facts["rings"] == facts["layers"]
    assert "smaller than the rounding" in text


def test_quiet_says_nothing(tmp_path: Path) -> None:
    text, _ = done(PARTS / "box.stl", tmp_path / "a.cli", "-q")

    assert text == ""
    assert (tmp_path / "a.cli").is_file()


def test_heights_are_dialled_as_in_all_commands(tmp_path: Path) -> None:
    _, facts = done(PARTS / "case_study.stl", tmp_path / "a.slc", "--planner", "area", "--heights", "0.1,0.3")
    file = read_slc((tmp_path / "a.slc").read_bytes())
    plan = LayerPlan.from_tops(np.array([*(z for z, _ in file.layers[1:]), file.top]))

    assert len(file.table) == len(facts["heights"]) > 1
    runs = np.repeat([height for _, height in facts["heights"]], [count for count, _ in facts["heights"]])
    np.testing.assert_allclose(plan.height, runs, atol=1e-4)
