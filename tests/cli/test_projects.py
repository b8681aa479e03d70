"""3MF projects of other slicers that are sliced: what objects have of their own is taken, what is not is named."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from command_line import typed

FACETS = ["021", "032", "456", "467", "015", "054", "126", "165", "237", "276", "304", "347"]
BOX = (
    "<mesh><vertices>"
    + "".join(
        f'<vertex x="{x}" y="{y}" z="{z}"/>' for z in (0, 4) for x, y in ((0, 0), (20, 0), (20, 20), (0, 20))
    )
    + "</vertices><triangles>"
    + "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in FACETS)
    + "</triangles></mesh>"
)
PRUSA, ORCA = "Metadata/Slic3r_PE_model.config", "Metadata/model_settings.config"
FLAGS = ("--printer", "marlin_220", "--material", "pla", "--quality", "standard", "--planner", "uniform")


def project(
    folder: Path,
    objects: dict[str, dict[str, str]],
    more: dict[str, str] | None = None,
    volumes: int = 1,
    file: str = PRUSA,
) -> Path:
    """Boxes side by side, each with settings of its own as PrusaSlicer keeps them, in its only volume."""
    bodies = "".join(f'<object id="{k}" type="model">{BOX}</object>' for k in range(1, len(objects) + 1))
    items = "".join(
        f'<item objectid="{k + 1}" transform="1 0 0 0 1 0 0 0 1 {30 * k} 0 0"/>' for k in range(len(objects))
    )
    rows = []
    for k, (name, settings) in enumerate(objects.items(), start=1):
        kind = ("object", "volume") if file == PRUSA else ("", "")
        called = (
            f'<metadata type="object" key="name" value="{name}"/>'
            if file == PRUSA
            else (f'<metadata key="name" value="{name}"/>')
        )
        own = "".join(
            f'<metadata type="{kind[1]}" key="{key}" value="{text}"/>' for key, text in settings.items()
        )
        tag = "volume" if file == PRUSA else "part"
        span = 12 // volumes
        parts = "".join(
            f'<{tag} id="{k}" subtype="normal_part" firstid="{n * span}" lastid="{n * span + span - 1}">{own}</{tag}>'
            for n in range(volumes)
        )
        rows.append(f'<object id="{k}">{called}{parts}</object>')
    path = folder / "project.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "3D/3dmodel.model",
            '<?xml version="1.0"?><model unit="millimeter" '
            'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">'
            f"<resources>{bodies}</resources><build>{items}</build></model>",
        )
        archive.writestr(file, f"<config>{''.join(rows)}</config>")
        for name, text in (more or {}).items():
            archive.writestr(name, text)
    return path


def moves(path: Path) -> list[str]:
    return [line for line in path.read_text().splitlines() if line.startswith(("G0", "G1", ";TYPE"))]


@pytest.mark.parametrize("file", [PRUSA, ORCA])
def test_a_project_is_sliced_with_what_its_object_has_of_its_own(file: str, tmp_path: Path) -> None:
    own = {
        PRUSA: {"perimeters": "5", "fill_density": "70%"},
        ORCA: {"wall_loops": "5", "sparse_infill_density": "70%"},
    }[file]
    path = project(tmp_path, {"lid": own}, file=file)
    (tmp_path / "plain").mkdir()
    plain = project(tmp_path / "plain", {"lid": {}}, file=file)

    taken = typed("slice", path, *FLAGS, "-o", tmp_path / "taken.gcode")
    typed_in = typed(
        "slice",
        plain,
        *FLAGS,
        "-o",
        tmp_path / "typed.gcode",
        "--set",
        "perimeters=5",
        "--set",
        "infill_density=0.7",
    )

    assert (taken.code, typed_in.code) == (0, 0)
    assert "lid: infill_density = 0.7, perimeters = 5 (from the project)" in taken.err
    assert moves(tmp_path / "taken.gcode") == moves(tmp_path / "typed.gcode")


def test_only_the_object_that_has_them_gets_them_and_typed_ones_come_over_them(tmp_path: Path) -> None:
    path = project(tmp_path, {"lid": {"perimeters": "5"}, "box": {}})

    def fed(*flags: object) -> list[float]:
        """Filament of the left and of the right box."""
        out = tmp_path / "out.gcode"
        assert typed("slice", path, *FLAGS, "-o", out, "--set", "infill_density=0", *flags).code == 0
        total, x, mode = [0.0, 0.0], 0.0, ""
        for line in out.read_text().splitlines():
            mode = line if line.startswith(";TYPE") else mode
            words = (
                {word[0]: word[1:] for word in line.partition(";")[0].split()[1:]} if line[:2] == "G1" else {}
            )
            x = float(words.get("X", x))
            if "E" in words and "X" in words and "perimeter" in mode.lower():
                total[x > 110] += max(float(words["E"]), 0.0)
        return total

    own, other = fed()
    assert own > 2 * other
    own, other = fed("--set-for", "lid:perimeters=2")
    assert own == pytest.approx(other, rel=0.02)


def test_what_is_not_used_is_named_and_in_the_json(tmp_path: Path) -> None:
    path = project(
        tmp_path,
        {
            "lid": {"brim_width": "5", "support_material_synchronize_layers": "1", "layer_height": "0.1"},
            "box": {"fill_density": "abc"},
        },
        {"Metadata/Slic3r_PE.config": "; perimeters = 3\n; layer_height = 0.2\n; fill_density = 20%\n"},
    )

    outcome = typed("slice", path, *FLAGS[:4], "-o", tmp_path / "out.gcode", "--json")
    warnings = "\n".join(json.loads(outcome.out)["warnings"])

    assert outcome.code == 0
    assert "project.3mf: lid: brim_width = 5 is not used" in warnings
    assert "project.3mf: lid: support_material_synchronize_layers = 1 is not used" in warnings
    assert (
        "project.3mf: lid: layer_height = 0.1 is not used: all objects on a plate have the same layers"
        in warnings
    )
    assert "project.3mf: box: its settings are not used" in warnings
    assert "the print, filament and printer settings in this file are not used" in warnings
    assert f"profiles import {path}" in warnings
    for line in warnings.splitlines():
        assert line in outcome.err


def test_settings_of_several_volumes_are_named(tmp_path: Path) -> None:
    path = project(tmp_path, {"lid": {"perimeters": "5"}}, volumes=2)

    outcome = typed("slice", path, *FLAGS, "-o", tmp_path / "out.gcode")

    assert outcome.code == 0
    assert "settings of single volumes are not imported" in outcome.err


@pytest.mark.parametrize(("flags", "height"), [((), 0.1), (("--set", "layer_height=0.25"), 0.25)])
def test_the_layer_height_of_the_only_object_is_that_of_the_plate(
    flags: tuple[str, ...], height: float, tmp_path: Path
) -> None:
    path = project(tmp_path, {"lid": {"layer_height": "0.1"}})
    outcome = typed("slice", path, *FLAGS[:6], *flags, "-o", tmp_path / "out.gcode")
    heights = np.diff(
        [
            float(line[3:])
            for line in (tmp_path / "out.gcode").read_text().splitlines()
            if line.startswith(";Z:")
        ]
    )

    assert outcome.code == 0
    assert ("layer_height = 0.1 is not used" in outcome.err) is bool(flags)
    if not flags:
        assert heights == pytest.approx(np.full(len(heights), height), abs=1e-6)


def test_a_damaged_project_is_printed_as_its_meshes_and_says_so(tmp_path: Path) -> None:
    ranges = {"Metadata/Prusa_Slicer_layer_config_ranges.xml": "<objects><object id='1'><range"}
    path = project(tmp_path, {"lid": {"perimeters": "5"}}, ranges)

    outcome = typed("slice", path, *FLAGS, "-o", tmp_path / "out.gcode")

    assert outcome.code == 0
    assert "its object settings are not used" in outcome.err


def test_dry_run_and_plan_take_them_too(tmp_path: Path) -> None:
    path = project(tmp_path, {"lid": {"perimeters": "5"}})

    for command in (("dry-run", path), ("plan", path)):
        outcome = typed(*command, *FLAGS)
        assert outcome.code == 0
        assert "lid: perimeters = 5 (from the project)" in outcome.err


def test_a_project_without_settings_of_a_print_is_no_profile_but_says_what_to_do(tmp_path: Path) -> None:
    path = project(tmp_path, {"lid": {"perimeters": "5"}})

    outcome = typed("profiles", "import", path, "--dry-run")

    assert outcome.code == 2
    assert "has only object settings, no print settings" in outcome.err
    assert "slice" in outcome.err
