"""Shapes with slender tips: their slices pass the check, and faults that are planted in them are found all the same."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import Areas, difference, offset, offset_open
from printer_slicer.inspection.coverage.model_check import Check, check_gcode
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from tests.csg import csg_shape
from tests.effort import crossed, few_of
from tests.parts import box, cone, joined

SEEDS = [9, 18, 22, 28, 29, 51]
"""Of sixty-six that were measured once: all of them had a finding before tips had limits of their own."""

DENSE = load_profile(changes={"infill_density": "1"})
WIDTH = 0.45
BEAD = re.compile(r"(G[123] .*X.* E|G[123] .*Y.* E)(\d*\.\d+)(.*)")


@cache
def sliced(seed: int) -> tuple[Mesh, str]:
    mesh = csg_shape(seed)
    return mesh, gcode_of(slice_stages(mesh, DENSE).program, DENSE).decode()


@cache
def checked(seed: int) -> Check:
    mesh, text = sliced(seed)
    return check_gcode(text.encode(), mesh)


def layers_of(text: str) -> list[list[str]]:
    """Lines before the first layer, and those of each layer."""
    parts: list[list[str]] = [[]]
    for line in text.splitlines():
        if line == ";LAYER_CHANGE":
            parts.append([])
        parts[-1].append(line)
    return parts


def with_layer(text: str, layer: int, change: Callable[[list[str]], list[str]]) -> bytes:
    """A text with the lines of one layer, counted from 0, changed."""
    parts = layers_of(text)
    parts[layer + 1] = change(parts[layer + 1])
    return "\n".join(line for part in parts for line in part).encode()


def half(lines: list[str]) -> list[str]:
    """Half the plastic in every bead."""
    return [
        f"{found[1]}{float(found[2]) / 2:.5f}{found[3]}" if (found := BEAD.fullmatch(line)) else line
        for line in lines
    ]


def twice(lines: list[str]) -> list[str]:
    """The plastic of every bead of the walls laid two times."""
    wall, kept = False, []
    for line in lines:
        wall = line.endswith("erimeter") if line.startswith(";TYPE:") else wall
        found = BEAD.fullmatch(line) if wall else None
        kept.append(f"{found[1]}{float(found[2]) * 2:.5f}{found[3]}" if found else line)
    return kept


FAULTS: dict[str, Callable[[list[str]], list[str]]] = {
    "missing layer": lambda _: [],
    "half the plastic": half,
    "wall laid twice": twice,
}


def needle(side: float, height: float) -> Mesh:
    """An upright pyramid."""
    base = [(0.0, 0.0, 0.0), (side, 0.0, 0.0), (side, side, 0.0), (0.0, side, 0.0)]
    top = (side / 2, side / 2, height)
    flanks = [[base[i], base[(i + 1) % 4], top] for i in range(4)]
    return Mesh(np.array([*flanks, [base[0], base[2], base[1]], [base[0], base[3], base[2]]]), "needle")


def own(check: Check) -> list[Diagnostic]:
    """What is found besides beads that hang where the shape does."""
    return [one for one in check.findings if not (one.code == "unsupported" and hangs(check, one.layer - 1))]


def hangs(check: Check, layer: int) -> bool:
    """Whether the section reaches out over air by more than a bead's width."""
    return bool(offset_open(overhang(check, WIDTH), WIDTH / 2).area()[layer] > 0)


def overhang(check: Check, reach: float) -> Areas:
    """What of each section lies more than `reach` mm beside the section below it."""
    solid = check.coverage.sections
    return difference(solid, offset(solid.shift_layers(1), reach))


@pytest.mark.parametrize("seed", few_of(SEEDS, 3))
def test_slices_of_shapes_with_slender_tips_pass(seed: int) -> None:
    check = checked(seed)

    assert check.problems == ()
    assert [(one.layer, one.message) for one in own(check)] == []


@pytest.mark.parametrize(
    ("fault", "seed", "where"), crossed(FAULTS, SEEDS[:3], ["lowest tip", "widest", "highest tip"])
)
def test_planted_faults_are_found_in_the_middle_and_near_the_tips(fault: str, seed: int, where: str) -> None:
    mesh, text = sliced(seed)
    area = checked(seed).coverage.sections.area()
    # Where sections grow fast, beads of the walls lie in the air, which is another finding.
    carried = overhang(checked(seed), WIDTH / 2).area() == 0
    small = [k for k in range(1, len(area) - 1) if 2.5 < area[k] < 20.0 and carried[k]]
    assert small
    layer = {"widest": int(np.argmax(area[:-1])), "lowest tip": small[0], "highest tip": small[-1]}[where]
    check = check_gcode(with_layer(text, layer, FAULTS[fault]), mesh)

    near = {
        k for one in check.findings for k in range(one.first - 2, one.last + 1) if one.code != "unsupported"
    }
    assert layer in near or check.problems, (layer, float(area[layer]))


@pytest.mark.parametrize(
    ("side", "height"), [(2.0, 12.0), pytest.param(3.0, 20.0, marks=pytest.mark.thorough)]
)
def test_the_tip_of_a_needle_that_no_bead_fits_into_is_not_missed(side: float, height: float) -> None:
    mesh = needle(side, height)
    text = gcode_of(slice_stages(mesh, DENSE).program, DENSE).decode()
    check = check_gcode(text.encode(), mesh)
    assert check.ok, (check.problems, own(check))

    parts = layers_of(text)
    shorter = "\n".join(line for part in parts[: -len(parts) // 3] for line in part).encode()

    assert any("below the top" in one for one in check_gcode(shorter, mesh).problems)


@pytest.mark.parametrize("fault", ["half the plastic", "wall laid twice"])
def test_a_pin_as_thick_as_three_beads_is_held_to_account(fault: str) -> None:
    """1.4 mm by 1.4 mm: what is let pass in a tip is not enough for a fault in a whole pin."""
    mesh = box((1.4, 1.4, 6.0))
    text = gcode_of(slice_stages(mesh, DENSE).program, DENSE).decode()
    assert check_gcode(text.encode(), mesh).ok

    check = check_gcode(with_layer(text, 8, FAULTS[fault]), mesh)

    assert any(8 in one.affected_layers for one in check.findings)


@pytest.mark.parametrize(
    ("heights", "turn"),
    [
        ("draft", 0.0),
        *(pytest.param(*case, marks=pytest.mark.thorough) for case in [("fine", 0.5), ("adaptive", 0.3)]),
    ],
)
def test_pins_and_cones_that_end_in_nothing_pass(heights: str, turn: float) -> None:
    profile = load_profile(quality=heights)
    tips = [
        Mesh(cone(radius, height, sides=24).triangles + np.array([9 * place, 7 * turn * place, 1.9]))
        for place, (radius, height) in enumerate([(1.0, 13.0), (1.4, 9.1), (2.5, 12.3), (0.6, 5.0)])
    ]
    part = joined([box((40.0, 20.0, 2.0), at=(-5.0, -8.0, 0.0)), *tips])
    text = gcode_of(slice_stages(part, profile).program, profile)

    assert list(check_gcode(text, part).findings) == []
    assert list(check_gcode(text, part).problems) == []
