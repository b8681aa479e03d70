"""What `slice` reports of overhangs without supports."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import printer_slicer as ps
from printer_slicer.model import Mesh
from tests.cli.command_line import typed
from tests.parts import box, cone, joined


def arm_with_cone() -> Mesh:
    """A post with an arm, from which a cone points down."""
    tip = cone(3, 5, 24)
    down = Mesh((tip.triangles * [1, 1, -1])[:, ::-1], "tip").moved((14, 3, 10.5))
    return joined([box((6, 6, 12)), box((20, 6, 2), (0, 0, 10)), down], "arm")


def sliced(mesh: Mesh, folder: Path, *more: str) -> tuple[str, dict[str, Any]]:
    """The text and the JSON of `slice`."""
    ps.export_stl(mesh, folder / "part.stl")
    command = ("slice", "part.stl", "--quality", "standard", "-o", "part.gcode", *more)
    return typed(*command, cwd=folder).out, json.loads(typed(*command, "--json", cwd=folder).out)


def test_slice_reports_islands_and_overhangs_in_one_line(tmp_path: Path) -> None:
    text, facts = sliced(arm_with_cone(), tmp_path)

    (line,) = [one.strip() for one in text.splitlines() if "Unsupported" in one]
    found = facts["overhangs"]
    (tip,) = found["largest_islands"]
    assert line.startswith("Unsupported: 1 island begins with nothing below (x, y, z 14.0, 3.0, 5.6)")
    assert f"{found['area_mm2']:.1f} mm² of overhangs are flatter than 40° (x, y, z " in line
    assert [tip[name] for name in "xyz"] == pytest.approx([14, 3, 5.5], abs=0.2)
    assert found["largest"][0]["area_mm2"] <= found["area_mm2"]
    assert found["islands"] == 1


def test_slice_reports_nothing_if_nothing_needs_supports(tmp_path: Path) -> None:
    text, facts = sliced(box(), tmp_path, "--set", "support=tree")

    assert facts["overhangs"] is None
    assert "Unsupported" not in text
    assert not facts["warnings"]


@pytest.mark.parametrize("style", ["columns", "tree"])
def test_slice_tells_how_much_plastic_and_time_supports_take(tmp_path: Path, style: str) -> None:
    plain, without = sliced(arm_with_cone(), tmp_path)
    text, facts = sliced(arm_with_cone(), tmp_path, "--supports", style)

    found = facts["supports"]
    assert without["supports"] is None
    assert found["style"] == style
    assert facts["filament_g"] - without["filament_g"] == pytest.approx(
        found["filament_g"], rel=0.05, abs=0.01
    )
    assert facts["overhangs"] is None
    assert "Unsupported: 1 island" in plain
    assert "Unsupported: an island" not in text
    assert f"Supports ({'trees' if style == 'tree' else style}): " in text
    assert "; support_material = 1\n" in (tmp_path / "part.gcode").read_text(encoding="utf-8")
