"""The gap between supports and flats, read from the G-code."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from printer_slicer.gcode import write_gcode
from printer_slicer.model import LayerPlan
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from tests.supports.shapes import tee

TALL, THICK = 6.0, 2.0
PART = tee(arm=6.0, height=TALL, thick=THICK)
MICRON = 1e-3


def extrusions(text: str) -> list[tuple[str, float, float, float]]:
    """Role, x, y and z of the end of every extrusion of a G-code."""
    found, role, place = [], "", {"X": 0.0, "Y": 0.0, "Z": 0.0}
    for line in text.splitlines():
        if line.startswith(";TYPE:"):
            role = line[6:]
        elif line.startswith(("G1 ", "G0 ")):
            words = {word[0]: float(word[1:]) for word in re.findall(r"[XYZE]-?[\d.]+", line)}
            place |= {axis: words[axis] for axis in "XYZ" if axis in words}
            if words.get("E", 0) > 0 and words.keys() & {"X", "Y"}:
                found.append((role, place["X"], place["Y"], place["Z"]))
    return found


def printed_gap(plan: LayerPlan | None, **changes: object) -> tuple[float, float]:
    """The gap under the arms by the G-code, and by the plan of supports, mm."""
    profile = load_profile(quality="standard", changes={"quality.support": "columns", **changes})
    stages = slice_stages(PART, profile, plan=plan)
    assert stages.supports is not None
    rows = extrusions(write_gcode(stages.program, profile).decode())
    top = max(z for role, *_, z in rows if role.startswith("Support material"))
    middle = float(stages.part.bounds.mean(axis=0)[0])
    layer_tops = stages.sections.plan.top
    lowest = min(z for role, x, _, z in rows if abs(x - middle) > 8.0 and "perimeter" in role)
    layer = int(np.abs(layer_tops - lowest).argmin())
    flat = np.flatnonzero(stages.supports.plan.carrier >= 0)
    return float(stages.sections.plan.bottom[layer]) - top, float(stages.supports.plan.gap[flat].max())


@settings(max_examples=8)
@given(st.lists(st.integers(10, 30), min_size=40, max_size=40), st.sampled_from([0.12, 0.15, 0.2, 0.3]))
def test_the_gap_is_exact_at_all_layer_heights(tall: list[int], gap: float) -> None:
    scale = (TALL + THICK) / (sum(tall) / 100)
    tops = np.round(np.cumsum(tall) / 100 * scale, 3)
    tops[-1] = TALL + THICK
    assume(np.ptp(np.clip(np.diff(tops, prepend=0.0), 0.08, 0.32) - np.diff(tops, prepend=0.0)) == 0)
    written, planned = printed_gap(LayerPlan.from_tops(tops), **{"quality.support_gap": gap})

    assert planned == pytest.approx(gap, abs=MICRON)
    assert written == pytest.approx(gap, abs=MICRON)


@pytest.mark.parametrize("gap", [0.15, 0.2, 0.3])
@pytest.mark.parametrize("kind", ["optimal", "cusp"])
def test_supports_with_the_layers_of_the_part_keep_the_gap(kind: str, gap: float) -> None:
    changes = {
        "quality.support_gap": gap,
        "quality.support_synchronize_layers": True,
        "quality.planner.kind": kind,
    }
    written, planned = printed_gap(None, **changes)

    assert planned == pytest.approx(gap, abs=MICRON)
    assert written == pytest.approx(gap, abs=MICRON)
