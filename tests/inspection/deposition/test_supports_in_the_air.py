"""Supports that begin in the air are found: no alarm about sliced parts, and an alarm about every planted gap."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from printer_slicer.arrays import Bool
from printer_slicer.gcode import write_gcode
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.inspection.deposition.support_gaps import SupportGaps
from printer_slicer.inspection.deposition.unsupported import UnsupportedExtrusion, unsupported_of_program
from printer_slicer.inspection.lint.scan import lint_text
from printer_slicer.model import Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.roles import Role, roles_with
from printer_slicer.values import replace
from tests.parts import box, joined
from tests.supports.shapes import bracket, hook, mushroom, sphere_on_bed, table, tee

SHAPES = {
    "tee": lambda: tee(15.0, 25.0),
    "hook": hook,
    "mushroom": lambda: mushroom(12.0, 20.0),
    "sphere": lambda: sphere_on_bed(12.0),
    "bracket": bracket,
    "table": lambda: table(40, 30, 20),
}
STYLES = ["columns", "tree"]
USUAL = [
    ("tee", "columns"),
    ("tee", "tree"),
    ("hook", "columns"),
    ("mushroom", "tree"),
    ("sphere", "columns"),
]
NEAR = 0.8  # mm; nearer extrusions belong to one branch
LEAST = 4.0  # mm of extrusion above a planted gap; less than 3 mm is not reported


@cache
def sliced(name: str, style: str, quality: str = "standard") -> tuple[Program, Profile]:
    profile = load_profile(quality=quality, changes={"support": style})
    return slice_stages(SHAPES[name](), profile).program, profile


def find_unsupported(program: Program, profile: Profile) -> tuple[UnsupportedExtrusion, ...]:
    return unsupported_of_program(program, profile)


def plant_gap(program: Program, seed: int) -> tuple[Program, float] | None:
    """Leave out one branch or column in one layer; return also z of the layer above it, where it is noticed.

    What lies above reaches hardly beyond it, so nothing else carries that.
    """
    rng = np.random.default_rng(seed)
    is_support = roles_with(is_support=True)[program.role] & (program.filament > 0)
    layers = np.unique(program.layer[is_support])
    for layer in rng.permutation(layers[1:-1]).tolist():
        here = np.flatnonzero(is_support & (program.layer == layer))
        branch = here[rng.integers(len(here))]
        gap = here[label(program, here) == label(program, here)[np.searchsorted(here, branch)]]
        above = np.flatnonzero(is_support & (program.layer == layers[np.searchsorted(layers, layer) + 1]))
        over = above[is_within(program, above, gap)]
        inside = (
            program.xyz[np.concatenate([over - 1, over]), :2],
            program.xyz[gap, :2].min(axis=0) - 1.0,
            program.xyz[gap, :2].max(axis=0) + 1.0,
        )
        covered = ((inside[0] >= inside[1]) & (inside[0] <= inside[2])).all()
        if covered and lengths(program)[over].sum() >= LEAST and stands_alone(program, over, above):
            role, filament = program.role.copy(), program.filament.copy()
            role[gap], filament[gap] = Role.TRAVEL, 0.0
            return replace(program, role=role, filament=filament), float(program.xyz[over[0], 2])
    return None


def lengths(program: Program) -> np.ndarray:
    return np.hypot(*np.diff(program.xyz[:, :2], axis=0, prepend=program.origin[None, :2]).T)


def boxes(program: Program, which: np.ndarray, more: float = NEAR / 2) -> Boxes:
    begin = np.concatenate([program.origin[None], program.xyz[:-1]])[which, :2]
    end = program.xyz[which, :2]
    return Boxes(np.minimum(begin, end) - more, np.maximum(begin, end) + more, np.zeros(len(which), np.int64))


def label(program: Program, which: np.ndarray) -> np.ndarray:
    """The branch of each move."""
    own = boxes(program, which)
    return label_components(np.stack(own.find_overlapping(own)), len(which))


def is_within(program: Program, which: np.ndarray, others: np.ndarray) -> Bool:
    """Which moves lie over others."""
    return boxes(program, which, 0.0).touches_any(boxes(program, others, 0.2))


def stands_alone(program: Program, over: np.ndarray, above: np.ndarray) -> bool:
    """Whether these moves are the whole of their branches, which others beside them do not hold."""
    if not len(over):
        return False
    branch = label(program, above)
    chosen = np.isin(above, over)
    return not np.isin(branch[~chosen], branch[chosen]).any()


@pytest.mark.parametrize(("name", "style"), USUAL)
def test_nothing_of_sliced_parts_is_in_the_air(name: str, style: str) -> None:
    assert find_unsupported(*sliced(name, style)) == ()


@pytest.mark.thorough
@pytest.mark.parametrize("quality", ["standard", "adaptive"])
@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", SHAPES)
def test_nothing_of_all_shapes_is_in_the_air(name: str, style: str, quality: str) -> None:
    assert find_unsupported(*sliced(name, style, quality)) == ()


def check_gap(name: str, style: str, seed: int) -> None:
    program, profile = sliced(name, style)
    planted = plant_gap(program, seed)
    assert planted is not None
    less, z = planted

    found = find_unsupported(less, profile)

    assert any(one.z == pytest.approx(z, abs=1e-6) for one in found)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("name", "style"), USUAL)
def test_a_planted_gap_is_found(name: str, style: str, seed: int) -> None:
    check_gap(name, style, seed)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(100, 200))
@pytest.mark.parametrize("name_and_style", [(name, style) for name in SHAPES for style in STYLES])
def test_every_planted_gap_is_found(name_and_style: tuple[str, str], seed: int) -> None:
    check_gap(*name_and_style, seed)


@pytest.mark.parametrize("style", STYLES)
def test_gaps_of_the_settings_are_not_air(style: str) -> None:
    part = joined([tee(15.0, 25.0), box((60.0, 30.0, 1.0), (-30.0, -10.0, 0.0))])
    gaps = {"support_gap": 1.0, "support_bottom_gap": 1.0}
    profile = load_profile(quality="standard", changes={"support": style, **gaps})
    program = slice_stages(part, profile).program

    assert find_unsupported(program, profile) == ()
    assert find_unsupported(program, load_profile(quality="standard")) != ()
    job = lint_text("tee.gcode", write_gcode(program, profile), profile)
    assert not [one for one in job.findings if one.code == "unsupported"]


def test_gaps_of_overrides_count() -> None:
    changes = {"overrides": [{"low": 2.0, "high": 5.0, "set": {"support_gap": 0.8}}]}

    assert SupportGaps.of(load_profile(quality="standard")) == SupportGaps()
    assert SupportGaps.of(load_profile(quality="standard", changes=changes)).above == pytest.approx(0.92)
