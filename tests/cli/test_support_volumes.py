"""Support enforcers and blockers on the command line and from Python, and those of 3MF files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import QUICK, is_message, typed

import printer_slicer as ps
from printer_slicer.cli.arguments import attach_values
from printer_slicer.cli.models import load_plate
from printer_slicer.cli.parser import build_parser
from printer_slicer.errors import UsageError
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.progress import quiet
from printer_slicer.values import replace
from tests.mesh_io.tiny_files import CORNERS, FACES, item, mesh_xml, model_xml, three_mf, write
from tests.parts import box, joined, plain


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export_stl(box((20, 30, 6)), tmp_path / "part.stl")
    export_stl(box((5, 5, 4), (10, 10, 1)), tmp_path / "one.stl")
    export_stl(box((5, 5, 4), (0, 0, 1)), tmp_path / "two.stl")
    return tmp_path


def plate(*words: object) -> ps.Mesh:
    """The mesh that `slice` slices."""
    words = tuple(attach_values(list(map(str, ("slice", *words)))))
    arguments = build_parser(words).parse_args(words)
    return load_plate(arguments, plain(), quiet)[0]  # type: ignore[arg-type]


def test_volumes_are_placed_with_the_models(folder: Path) -> None:
    flags = ("--scale", "2", "--rotate", "90", "--copies", "2")
    mesh = plate(
        folder / "part.stl",
        *flags,
        "--support-enforcer",
        folder / "one.stl",
        "--support-blocker",
        folder / "two.stl",
    )
    volumes = mesh.all_volumes

    assert volumes and volumes.enforce and volumes.block and not volumes.negative  # noqa: PT018 - for the types
    low = mesh.bounds[0]
    assert volumes.enforce.n_facets == volumes.block.n_facets == 24
    assert volumes.enforce.bounds[0] - low == pytest.approx([30, 20, 2])
    assert volumes.block.bounds[0] - low == pytest.approx([50, 0, 2])


def test_several_volumes_add_up(folder: Path) -> None:
    mesh = plate(
        folder / "part.stl", "--support-blocker", folder / "one.stl", "--support-blocker", folder / "two.stl"
    )

    assert mesh.volumes
    assert mesh.volumes.block
    assert np.array_equal(mesh.volumes.block.bounds, [[0, 0, 1], [15, 15, 5]])
    assert mesh.volumes.enforce is None


def test_enforcers_without_supports_are_reported(folder: Path) -> None:
    words = ("slice", folder / "part.stl", "-o", folder / "x.gcode", "--json", *QUICK)
    outcome = typed(*words, "--support-enforcer", folder / "one.stl")

    assert outcome.code == 0, outcome.err
    assert any("supports are off" in text for text in json.loads(outcome.out)["warnings"])
    assert "supports are off" in outcome.err
    assert "supports" not in typed(*words, "--support-blocker", folder / "one.stl").err


def test_a_volume_that_is_no_model_is_refused(folder: Path) -> None:
    outcome = typed("slice", folder / "part.stl", "--support-enforcer", folder / "none.stl", *QUICK)

    assert outcome.code != 0
    assert is_message(outcome)
    assert "none.stl" in outcome.err


def test_volumes_do_not_apply_to_gcode(folder: Path) -> None:
    (folder / "x.gcode").write_text("G28\n")
    outcome = typed("print", folder / "x.gcode", "--support-blocker", folder / "one.stl", "--port", "sim:")

    assert outcome.code != 0
    assert "--support-blocker does not apply to G-code" in outcome.err


def negative_3mf(folder: Path) -> Path:
    """A box of 20 x 30 x 40 mm, of which a corner of 10 x 15 x 20 mm is cut out."""
    mesh = mesh_xml(np.concatenate([CORNERS * 10, CORNERS * 5]), np.concatenate([FACES, FACES + 8]))
    config = (
        '<config><object id="1"><volume firstid="0" lastid="11"/><volume firstid="12" lastid="23">'
        '<metadata type="volume" key="volume_type" value="NegativeVolume"/></volume></object></config>'
    )
    content = three_mf(model_xml({1: mesh}, item(1)), {"Metadata/Slic3r_PE_model.config": config})
    return write(folder, content, "corner.3mf")


def test_python_takes_volumes(folder: Path) -> None:
    part, hole = box((20, 30, 6)), box((10, 10, 10), (5, 5, -1))
    stages = ps.slice_stages(part, plain(), volumes=ps.Volumes(negative=hole, block=hole))

    assert stages.sections.solid.area() == pytest.approx(np.full(stages.plan.n_layers, 500.0))
    assert stages.part.volumes
    assert stages.part.volumes.block
    assert stages.part.volumes.block.bounds[0] - stages.part.bounds[0] == pytest.approx([5, 5, -1])
    again = ps.slice_stages(part.with_volumes(ps.Volumes(negative=hole)), plain())
    assert np.array_equal(again.sections.solid.area(), stages.sections.solid.area())
    assert ps.job_of(part, plain(), volumes=ps.Volumes(negative=hole)).text != ps.job_of(part, plain()).text


@pytest.mark.parametrize("volumes", [box((1, 1, 1)), "one.stl"])
def test_volumes_of_another_type_are_refused(volumes: Any) -> None:
    for call in (
        lambda: ps.slice_stages(box((20, 30, 6)), plain(), volumes=volumes),
        lambda: ps.slice(box((20, 30, 6)), volumes=volumes),
        lambda: ps.Volumes(enforce=[volumes]),  # type: ignore[arg-type]
    ):
        with pytest.raises(UsageError) as caught:
            call()
        assert caught.value.remedy


def tee() -> ps.Mesh:
    """A stem of 20 mm height with an arm of 15 x 10 mm to either side at its top."""
    return joined([box((10, 10, 25), (-5, -5, 0)), box((40, 10, 5), (-20, -5, 20))], "tee")


def with_supports(style: str) -> ps.Profile:
    profile = plain()
    return replace(profile, quality=replace(profile.quality, support=style))


def test_volumes_steer_what_gets_supports() -> None:
    right = Mesh(box((40, 40, 10), (0, -20, 15)).triangles)
    enforced = {
        "all": ps.overhangs(tee(), plain()),
        "blocked": ps.overhangs(tee(), plain(), volumes=ps.Volumes(block=right)),
        "off": ps.slice_stages(tee(), plain(), volumes=ps.Volumes(block=right)).overhangs,
        "on": ps.slice_stages(tee(), with_supports("auto"), volumes=ps.Volumes(block=right)).overhangs,
    }
    area = {name: found.area.area().sum() for name, found in enforced.items() if found}

    assert area["all"] == pytest.approx(300, rel=0.01)
    assert area["blocked"] == area["on"] == pytest.approx(150, rel=0.01)
    assert area["off"] == area["all"]


def test_what_the_rules_leave_out_can_be_enforced() -> None:
    """A bridge of 8 mm, and a step of 0.4 mm."""
    part = joined([box((20, 10, 6), (0, 0, 6)), *(box((6, 10, 7), (x, 0, 0)) for x in (0, 14))], "bridge")
    step = joined([part, box((20.4, 10, 4), (0, 0, 9))], "step")
    everywhere = ps.Volumes(enforce=Mesh(box((90, 90, 90), (-30, -30, -30)).triangles))
    found = ps.overhangs(step, plain(), volumes=everywhere)

    assert ps.overhangs(step, plain()).area.n_rings == 0
    assert found.area.area().sum() == pytest.approx(80 + 4, rel=0.02)
    assert found.n_patches == 2


def test_blocked_islands_are_reported(folder: Path) -> None:
    hanging = joined([box((10, 10, 25)), box((20, 10, 5), (0, 0, 20)), box((4, 4, 15), (14, 3, 6))], "hook")
    export_stl(hanging, folder / "hook.stl")
    export_stl(box((10, 20, 10), (12, -5, 0)), folder / "block.stl")
    words = ("slice", folder / "hook.stl", "-o", folder / "x.gcode", "--set", "support=auto", *QUICK)
    outcome = typed(*words, "--support-blocker", folder / "block.stl")

    assert outcome.code == 0, outcome.err
    said = " ".join(outcome.err.split())
    assert "an island of 16 mm² at x, y, z 16.0, 5.0, " in said
    assert " begins with nothing below: a support blocker covers it" in said
    assert "an island of" not in typed(*words).err


def test_volumes_of_a_file_are_used(folder: Path) -> None:
    path = negative_3mf(folder)
    area = ps.slice_stages(load_mesh(path), plain()).sections.solid.area()
    outcome = typed("slice", path, "-o", folder / "x.gcode", "--json", *QUICK)

    assert area[0] == pytest.approx(450)
    assert area[-1] == pytest.approx(600)
    assert outcome.code == 0, outcome.err
    assert any("negative volumes" in text for text in json.loads(outcome.out)["warnings"])


def test_painted_facets_without_supports_are_reported(folder: Path) -> None:
    """Unless one object has supports."""
    mesh = mesh_xml(CORNERS * 5).replace('v1="0"', 'paint_supports="4" v1="0"', 1)
    text = model_xml({1: mesh}, item(1)).replace('<object id="1"', '<object name="lid" id="1"')
    path = write(folder, three_mf(text), "painted.3mf")
    words = ("slice", path, "-o", folder / "x.gcode", *QUICK)

    columns = typed(*words, "--supports", "columns").err
    assert "no overhang lies at the facets that are painted for supports" in " ".join(columns.split())
    assert "enforcer" not in columns
    assert "facets painted for supports, but supports are off" in " ".join(typed(*words).err.split())
    for name in ("support", "quality.support"):
        assert "supports are off" not in typed(*words, "--set-for", f"lid:{name}=columns").err
