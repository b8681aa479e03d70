"""The planner's minutes: those of the program's moves, on every machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.profile import Profile, profile_with
from printer_slicer.surface import read_surface
from tests.effort import crossed, examples
from tests.parts import box, box_with_hole, cone, prism, sphere, step_pyramid, two_boxes
from tests.planning.machines import MACHINES, machine, on_another_clock

CLOSE: Final = 0.16
"""Of the program's minutes."""


def comb(teeth: int = 16) -> Mesh:
    """A prism of many short strokes: no machine gets up to speed on its teeth."""
    tips = [
        (radius * np.cos(angle), radius * np.sin(angle))
        for angle, radius in zip(
            np.linspace(0, 2 * np.pi, 2 * teeth, endpoint=False), [22.0, 17.0] * teeth, strict=True
        )
    ]
    return prism(tips, 6.0)


PARTS: Final[Mapping[str, Mesh]] = {
    "comb": comb(),
    "block": box((40, 30, 8)),
    "hole": box_with_hole((40.0, 40.0, 8.0), (20.0, 12.0)),
    "two boxes": two_boxes((20.0, 20.0, 6.0)),
    "cone": cone(20, 15),
    "sphere": sphere(12),
    "steps": step_pyramid([40, 28, 16], [2.0, 3.1, 2.5]),
}
any_machine = pytest.mark.parametrize("name", MACHINES)


def modelled(mesh: Mesh, profile: Profile, plan: LayerPlan) -> Float:
    """(L,) s."""
    times = LayerTimes(read_surface(mesh), profile, (plan.top + plan.bottom) / 2)
    return np.array([times.seconds(np.array([i]), float(h))[0] for i, h in enumerate(plan.height)])


@pytest.mark.parametrize(("name", "part"), crossed(MACHINES, PARTS))
def test_modelled_minutes_are_those_of_the_moves(part: str, name: str) -> None:
    wanted = machine(name, planner__kind="uniform", layer_height=0.2)
    mesh = place(PARTS[part], wanted.printer)
    plan = plan_layers(mesh, wanted)
    seconds = float(move_seconds(slice_part(mesh, wanted, plan=plan), wanted).sum())

    assert float(modelled(mesh, wanted, plan).sum()) == pytest.approx(seconds, rel=CLOSE)


@any_machine
@settings(max_examples=examples(8))
@given(k=st.floats(0.3, 3.0), part=st.sampled_from([*PARTS]), height=st.sampled_from([0.1, 0.2, 0.28]))
def test_a_machine_on_another_clock_takes_the_time_of_that_clock(
    name: str, k: float, part: str, height: float
) -> None:
    usual = machine(name, planner__kind="uniform", layer_height=height)
    plan = plan_layers(PARTS[part], usual)
    before, after = (modelled(PARTS[part], one, plan) for one in (usual, on_another_clock(usual, k)))

    assert after * k == pytest.approx(before, rel=1e-6)


BETTER: Final[Mapping[str, dict[str, Any]]] = {
    "accelerates harder": {"printer.acceleration": 40000, "accelerations.default": 40000},
    "melts more": {"printer.hotend_max_flow": 60},
    "travels faster": {"speeds.travel": 900},
    "needs no time to cool": {"material.min_layer_time": 0},
}


@any_machine
@pytest.mark.parametrize("change", BETTER)
def test_no_layer_is_slower_on_a_better_machine(name: str, change: str) -> None:
    usual = machine(name, planner__kind="uniform", layer_height=0.3)
    better = profile_with(usual, BETTER[change])
    for part in ("comb", "steps"):
        plan = plan_layers(PARTS[part], usual)
        before, after = (modelled(PARTS[part], one, plan) for one in (usual, better))
        assert (after <= before * (1 + 1e-9)).all()


@any_machine
def test_thick_layers_save_less_where_the_hotend_is_the_limit(name: str) -> None:
    """With a hotend that melts next to nothing, minutes follow the plastic and not the number of layers."""
    weak = machine(name, planner__kind="uniform", of="standard", layer_height=0.2)
    weak = profile_with(
        weak, {"printer.hotend_max_flow": 0.5, "material.max_flow": 0, "material.min_layer_time": 0}
    )
    thin, thick = (
        modelled(
            PARTS["block"], weak, plan_layers(PARTS["block"], profile_with(weak, {"layer_height": height}))
        )
        for height in (0.1, 0.2)
    )

    assert thick[1:].sum() == pytest.approx(thin[2:].sum(), rel=0.12)
