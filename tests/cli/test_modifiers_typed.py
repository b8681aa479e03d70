"""Modifiers on the command line and in 3MF projects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import QUICK, typed

from printer_slicer.mesh_io import export_stl, load_mesh
from tests.mesh_io.tiny_files import CORNERS, FACES, item, mesh_xml, model_xml, three_mf, write
from tests.parts import box

MIRRORED = (-1, 0, 0, 0, 1, 0, 0, 0, 1, 100, 50, 0)
TURNED = (0, 2, 0, -2, 0, 0, 0, 0, 2, 0, 0, 0)
PRUSA = """<config><object id="1"><metadata type="object" key="name" value="lid"/>
<volume firstid="0" lastid="11"><metadata type="volume" key="volume_type" value="ModelPart"/></volume>
<volume firstid="12" lastid="23"><metadata type="volume" key="name" value="slab"/>
<metadata type="volume" key="volume_type" value="ParameterModifier"/>
<metadata type="volume" key="matrix" value="-1 0 0 9 0 1 0 0 0 0 1 0 0 0 0 1"/>
<metadata type="volume" key="fill_density" value="80%"/><metadata type="volume" key="perimeters" value="5"/>
</volume></object></config>"""
ORCA = """<config><object id="9"><metadata key="name" value="lid"/>
<part id="1" subtype="normal_part"><metadata key="name" value="box"/></part>
<part id="2" subtype="modifier_part"><metadata key="name" value="slab"/>
<metadata key="sparse_infill_density" value="80%"/><metadata key="wall_loops" value="5"/></part></object></config>"""
LARGE = CORNERS * 10
"""A box of 20 x 30 x 40 mm."""
HALF = LARGE * np.array([0.5, 1.0, 1.0])


def prusaslicer(folder: Path, items: str) -> Path:
    mesh = mesh_xml(np.concatenate([LARGE, HALF]), np.concatenate([FACES, FACES + 8]))
    content = three_mf(model_xml({1: mesh}, items), {"Metadata/Slic3r_PE_model.config": PRUSA})
    return write(folder, content, "prusa.3mf")


def orcaslicer(folder: Path, matrix: tuple[float, ...]) -> Path:
    """The modifier is a component, mirrored twice if the matrix mirrors: by its own transform, and by the object's."""
    place = " ".join(f"{value:g}" for value in matrix)
    inner = "".join(f'<component objectid="{k}" transform="{place}"/>' for k in (1, 2))
    inner = f"<components>{inner}</components>"
    text = model_xml({1: mesh_xml(LARGE), 2: mesh_xml(HALF), 9: inner}, item(9, MIRRORED))
    return write(folder, three_mf(text, {"Metadata/model_settings.config": ORCA}), "orca.3mf")


def sliced(path: Path, folder: Path, *words: object) -> tuple[dict[str, Any], str]:
    outcome = typed("slice", path, *words, *QUICK, "-o", folder / "out.gcode", "--json")
    assert outcome.code == 0, outcome.err
    return json.loads(outcome.out), outcome.err


def used(facts: dict[str, Any]) -> float:
    """Filament of a print, mm."""
    (found,) = [
        value for key, value in facts.items() if key.startswith("filament") and isinstance(value, float)
    ][:1]
    return found


@pytest.mark.parametrize("kind", ["prusaslicer", "orcaslicer"])
def test_settings_of_projects_apply_within_their_modifiers(kind: str, tmp_path: Path) -> None:
    path = prusaslicer(tmp_path, item(1, MIRRORED)) if kind == "prusaslicer" else orcaslicer(tmp_path, TURNED)
    facts, said = sliced(path, tmp_path)
    plain, _ = sliced(path, tmp_path, "--set-for", "lid/slab:infill_density=0.1")
    full, _ = sliced(path, tmp_path, "--set-for", "lid/slab:infill_density=1")

    assert "lid/slab: infill_density = 0.8 (from the project)" in said
    assert "is not used: perimeters is the same for the whole object here" in said
    assert used(plain) < used(facts) < used(full)


@pytest.mark.parametrize("matrix", [MIRRORED, TURNED])
def test_modifiers_lie_where_their_part_lies(matrix: tuple[float, ...], tmp_path: Path) -> None:
    mesh = load_mesh(orcaslicer(tmp_path, matrix))
    assert mesh.volumes is not None
    (slab,) = mesh.volumes.modifiers

    assert mesh.volume > 0
    assert slab.volume == pytest.approx(mesh.volume / 2)
    assert (slab.bounds[0] >= mesh.bounds[0] - 1e-9).all()
    assert (slab.bounds[1] <= mesh.bounds[1] + 1e-9).all()


def test_meshes_of_the_command_line_are_modifiers(tmp_path: Path) -> None:
    export_stl(box((20, 20, 6)), tmp_path / "part.stl")
    export_stl(box((10, 20, 6)), tmp_path / "dense.stl")
    words = ("--modifier", tmp_path / "dense.stl")
    without, said = sliced(tmp_path / "part.stl", tmp_path, *words)
    dense, quiet = sliced(tmp_path / "part.stl", tmp_path, *words, "--set-for", "dense:infill_density=90%")
    _, walls = sliced(tmp_path / "part.stl", tmp_path, *words, "--set-for", "dense:perimeters=4")

    assert "the modifier 'dense' has no settings" in said
    assert "modifier" not in quiet
    assert used(dense) > 1.1 * used(without)
    assert "the modifier 'dense' does not change perimeters" in walls
