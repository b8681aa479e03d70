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
from printer_slicer.progress import quiet
from tests.mesh_io.tiny_files import CORNERS, FACES, item, mesh_xml, model_xml, three_mf, write
from tests.parts import box, plain


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
    return load_plate(arguments, plain().printer, quiet)[0]  # type: ignore[arg-type]


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
    volumes = mesh.volumes

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


def test_volumes_of_a_file_are_used(folder: Path) -> None:
    path = negative_3mf(folder)
    area = ps.slice_stages(load_mesh(path), plain()).sections.solid.area()
    outcome = typed("slice", path, "-o", folder / "x.gcode", "--json", *QUICK)

    assert area[0] == pytest.approx(450)
    assert area[-1] == pytest.approx(600)
    assert outcome.code == 0, outcome.err
    assert any("negative volumes" in text for text in json.loads(outcome.out)["warnings"])
