"""Planners, infill, flavours and post-processors passed as functions: used from outside, refused with advice."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import printer_slicer as ps
from tests.parts import box, cone

PROFILE = ps.load_profile("marlin_220", "pla", "standard", {"skirt_loops": 0})
PART = box((20, 15, 4))


def sliced(**strategies: Any) -> ps.Stages:
    return ps.slice_stages(PART, PROFILE, strategies=ps.Strategies(**strategies))


def tops(part: ps.Mesh, profile: ps.Profile, height: float) -> NDArray[np.float64]:
    """Equal layers, rounded to the printer's steps."""
    count = round(part.height / height)
    step = profile.printer.z_step
    return np.round(np.arange(1, count + 1) * part.height / count / step) * step


def thinner_to_the_top(part: ps.Mesh, profile: ps.Profile) -> ps.LayerPlan:
    """A planner of one's own."""
    low = tops(part, profile, 0.25)
    return ps.LayerPlan.from_tops(np.unique(np.concatenate([low[:8], tops(part, profile, 0.125)[16:]])))


def columns(task: ps.InfillTask) -> ps.Polylines:
    """Infill of one's own: upright lines through the whole box of each area, for us to cut."""
    low, high = task.area.boxes()

    def of(k: int) -> Iterator[NDArray[np.float64]]:
        for x in np.arange(low[k, 0] // task.spacing, high[k, 0] // task.spacing + 1) * task.spacing:
            yield np.array([(x, low[k, 1] - 1), (x, high[k, 1] + 1)])

    return ps.Polylines.from_lines(
        [list(of(k)) if used else [] for k, used in enumerate(task.area.used.tolist())]
    )


def sparse_volume(stages: ps.Stages) -> float:
    program = stages.program
    area = np.pi / 4 * PROFILE.material.filament_diameter**2
    return float(program.filament[program.role == ps.Role.INTERNAL_INFILL].sum() * area)


# What can be done


def test_a_planner_from_outside_decides_about_the_layers() -> None:
    stages = sliced(planner=thinner_to_the_top)

    assert stages.plan.runs() == [(8, 0.25), (16, 0.125)]
    assert stages.plan.planner == "thinner_to_the_top"
    assert ps.dry_run(ps.job_of(stages, PROFILE), PROFILE).ok


def test_a_planner_may_name_itself_and_is_asked_by_plan_part_too() -> None:
    def named(part: ps.Mesh, profile: ps.Profile) -> ps.LayerPlan:
        return ps.LayerPlan.from_tops(tops(part, profile, 0.2), "twenty layers")

    plan = ps.plan_part(PART, PROFILE, ps.Strategies(planner=named))

    assert (plan.n_layers, plan.planner) == (20, "twenty layers")


def test_infill_from_outside_is_cut_to_the_areas_and_has_the_density() -> None:
    stages = sliced(infill=columns)
    own, ours = sparse_volume(stages), sparse_volume(sliced())
    sparse = stages.toolpaths.role == ps.Role.INTERNAL_INFILL
    points = np.repeat(sparse, np.diff(stages.toolpaths.start))
    low, high = stages.part.bounds[:, :2]

    assert sparse.any()
    assert own == pytest.approx(ours, rel=0.05)
    assert (stages.toolpaths.xy[points] > low).all()
    assert (stages.toolpaths.xy[points] < high).all()
    assert ps.dry_run(ps.job_of(stages, PROFILE), PROFILE).ok


@pytest.mark.parametrize("density", [0.08, 0.15, 0.4])
def test_the_density_holds_for_infill_from_outside_whatever_it_is(density: float) -> None:
    profile = ps.profile_with(PROFILE, {"infill_density": density})
    stages = ps.slice_stages(PART, profile, strategies=ps.Strategies(infill=columns))
    ours = ps.slice_stages(PART, profile)

    assert sparse_volume(stages) == pytest.approx(sparse_volume(ours), rel=0.06)


def test_infill_from_outside_may_have_a_density_of_its_own() -> None:
    def few(task: ps.InfillTask) -> ps.Polylines:
        return columns(replace(task, spacing=5 * task.spacing))

    stages = sliced(infill=ps.Infill(few, measured=False))

    assert 0 < sparse_volume(stages) < 0.7 * sparse_volume(sliced())


def test_loops_can_be_infill() -> None:
    def rings(task: ps.InfillTask) -> ps.Polylines:
        return ps.Polylines.around(task.area)

    stages = sliced(infill=ps.Infill(rings, measured=False))

    assert sparse_volume(stages) > 0


def test_a_flavour_from_outside_says_things_its_own_way() -> None:
    mine = replace(ps.FLAVOURS["marlin"], acceleration=lambda value: f"M204 S{value:g} ; mine")
    profile = ps.profile_with(PROFILE, {"accelerations.external_perimeter": 400})
    stages = ps.slice_stages(PART, profile)
    job = ps.job_of(stages, profile, strategies=ps.Strategies(flavour=mine))

    assert b"M204 S400 ; mine" in job.text
    assert b"mine" not in ps.job_of(stages, profile).text


def test_a_post_processor_of_moves_changes_what_is_printed_and_timed() -> None:
    def slower(program: ps.Program) -> ps.Program:
        return replace(program, speed=np.minimum(program.speed, 20.0))

    stages = sliced(on_program=[slower])
    job = ps.job_of(stages, PROFILE)

    assert stages.program.speed.max() == 20
    assert job.seconds > ps.job_of(PART, PROFILE).seconds
    assert ps.dry_run(job, PROFILE).ok


def test_post_processors_run_one_after_the_other() -> None:
    def halved(program: ps.Program) -> ps.Program:
        return replace(program, speed=program.speed / 2)

    once, twice = sliced(on_program=halved), sliced(on_program=[halved, halved])

    assert np.allclose(once.program.speed, 2 * twice.program.speed)


def test_a_post_processor_of_lines_has_the_last_word() -> None:
    def loud(lines: list[str]) -> Iterator[str]:
        for line in lines:
            yield line
            if line.startswith(";LAYER_CHANGE"):
                yield "M117 another one"

    plain = ps.job_of(PART, PROFILE)
    job = ps.job_of(PART, PROFILE, strategies=ps.Strategies(on_lines=loud))

    assert plain.plan is not None
    assert len(job.commands) == len(plain.commands) + plain.plan.n_layers
    assert job.text.replace(b"M117 another one\n", b"") == plain.text


def test_what_post_processors_add_is_judged_like_everything_else() -> None:
    def hot(lines: list[str]) -> list[str]:
        return [*lines, "M104 S400"]

    job = ps.job_of(PART, PROFILE, strategies=ps.Strategies(on_lines=hot))

    assert "temperature" in {one.code for one in job.findings if one.is_error}


def test_the_file_tells_which_functions_made_it() -> None:
    chosen = ps.Strategies(planner=thinner_to_the_top, infill=columns)
    text = ps.job_of(PART, PROFILE, strategies=chosen).text.decode()

    assert "; planner = thinner_to_the_top, a user function\n" in text
    assert "; infill = columns, a user function\n" in text


def test_without_functions_nothing_changes() -> None:
    assert ps.job_of(PART, PROFILE, strategies=ps.Strategies()).text == ps.job_of(PART, PROFILE).text


def test_what_a_function_raises_is_passed_on() -> None:
    def broken(_part: ps.Mesh, _profile: ps.Profile) -> ps.LayerPlan:
        raise LookupError("my own slip")

    with pytest.raises(LookupError, match="my own slip"):
        sliced(planner=broken)


# What is refused


def plan_of(heights: Iterable[float], cut: float = 0.5) -> Callable[..., ps.LayerPlan]:
    def mine(*_: object) -> ps.LayerPlan:
        return ps.LayerPlan.from_tops(np.cumsum(list(heights)), cut_ratio=cut)

    return mine


def mine(value: object) -> Callable[..., Any]:
    """A function that gives this value, whatever it is asked."""

    def given(*_: object) -> Any:
        return value

    return given


def changed(**columns_: Any) -> Callable[[ps.Program], ps.Program]:
    def change(program: ps.Program) -> ps.Program:
        made = {name: value(program) if callable(value) else value for name, value in columns_.items()}
        return replace(program, **made)

    return change


def with_nan(program: ps.Program) -> NDArray[np.float64]:
    xyz = program.xyz.copy()
    xyz[7, 1] = np.nan
    return xyz


def line_at(layer: int, *points: tuple[float, float]) -> Callable[..., ps.Polylines]:
    """One line on one layer."""
    return mine(ps.Polylines.of(np.array(points), np.array([len(points)]), np.array([layer])))


def upside_down(task: ps.InfillTask) -> ps.Polylines:
    lines = columns(task)
    return ps.Polylines(lines.xy, lines.start, lines.layer[::-1], lines.edge, lines.closed)


REFUSED: dict[str, tuple[dict[str, Any], str, str]] = {
    "a planner that gives nothing": (
        {"planner": mine(None)},
        "planner given: returned nothing, not a LayerPlan",
        "LayerPlan.from_tops",
    ),
    "a planner that gives an array": (
        {"planner": mine(np.array([0.2, 0.4]))},
        "returned a value of type ndarray",
        "LayerPlan.from_tops",
    ),
    "a planner that gives no layers": (
        {"planner": plan_of([])},
        "returned no layers",
        "which is 4 mm high",
    ),
    "layers that are too thick": (
        {"planner": plan_of([0.2, 3.8])},
        "layer 2 is 3.8 mm high (top 4 mm), but 'Marlin bed-slinger 220, 0.4 mm nozzle' prints layers of 0.08",
        "max_layer",
    ),
    "layers that go down": (
        {"planner": plan_of([0.2, 0.2, -0.2])},
        "layer 3 is -0.2 mm high",
        "min_layer",
    ),
    "layers that are not numbers": (
        {"planner": plan_of([0.2, np.nan])},
        "layer 2 is nan mm high",
        "min_layer",
    ),
    "layers between the steps of z": (
        {"planner": plan_of([0.2, 0.2013])},
        "layer 2 ends at 0.4013 mm, not on a whole number of z steps of 0.0025 mm",
        "np.round(tops / step) * step",
    ),
    "layers that end below the top": (
        {"planner": plan_of([0.2] * 10)},
        "the last layer goes from 1.8 to 2 mm, but the part ends at 4 mm",
        "part.height",
    ),
    "layers that go on above the top": (
        {"planner": plan_of([0.2] * 21)},
        "the last layer goes from 4 to 4.2 mm",
        "part.height",
    ),
    "layers that are cut at their border": (
        {"planner": plan_of([0.2] * 20, cut=1.0)},
        "layer 1 from 0 to 0.2 mm is cut at 0.2 mm",
        "cuts it in the middle",
    ),
    "a planner that is a name": ({"planner": "cusp"}, "'cusp' cannot be called", "quality.planner"),
    "infill that is a number": ({"infill": 5}, "infill: 5 cannot be called", "Pass a function"),
    "infill that gives points": (
        {"infill": mine([(1, 2), (3, 4)])},
        "infill given: returned a value of type list instead of Polylines",
        "from_lines",
    ),
    "infill for areas that there are not": (
        {"infill": line_at(999, (0, 0), (1, 1))},
        "has lines for area 999, but the task has",
        "Count areas from 0",
    ),
    "infill out of order": ({"infill": upside_down}, "not sorted by area", "Sort them"),
    "infill that is nowhere": (
        {"infill": line_at(3, (0, 0), (np.inf, 1))},
        "point 1 is at x inf, y 1",
        "divisions by zero",
    ),
    "infill that is too dense": (
        {"infill": lambda task: columns(replace(task, spacing=task.spacing / 4))},
        "infill <lambda>: extrudes 2.5 times the volume",
        "measured=False",
    ),
    "infill that lays nothing": (
        {"infill": mine(ps.Polylines.from_lines([]))},
        "extrudes 0 times the volume of infill_density = 0.15",
        "task.spacing",
    ),
    "a flavour that is a name": ({"flavour": "marlin"}, "is a value of type str, not a Dialect", "FLAVOURS"),
    "moves that are none": (
        {"on_program": mine(None)},
        "on_program given: returned nothing",
        "replace(program",
    ),
    "moves to nowhere": (
        {"on_program": changed(xyz=with_nan)},
        "move 7 is invalid: it goes to x",
        "finite numbers",
    ),
    "moves without speed": (
        {"on_program": changed(speed=lambda program: program.speed * 0)},
        "at 0 mm/s",
        "speed above 0",
    ),
    "moves in no order": (
        {"on_program": changed(layer=lambda program: program.layer[::-1])},
        "the layer numbers of the moves do not ascend from 0 to",
        "layers in order",
    ),
    "moves of another plan": (
        {"on_program": changed(plan=ps.LayerPlan.from_tops(np.array([0.2])))},
        "changed the number of layers from 20 to 1",
        "a planner chooses the layers",
    ),
    "events in no order": (
        {"on_program": changed(events=lambda program: program.events[::-1])},
        "the events are not sorted by the index",
        "index of each event",
    ),
    "a post-processor that is none": ({"on_lines": [3]}, "on_lines: 3 cannot be called", "Pass a function"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_nonsense_is_refused_with_what_and_where_and_remedy(case: str) -> None:
    given, what, remedy = REFUSED[case]

    with pytest.raises(ps.StrategyError, match=re.escape(what)) as refused:
        sliced(**given)

    assert remedy in refused.value.remedy


LINES: dict[str, tuple[Callable[[list[str]], Any], str, str]] = {
    "text": ("\n".join, "returned a value of type str, not lines", "list of lines"),
    "nothing": (lambda _: None, "returned nothing, not lines", "yield them"),
    "no text": (lambda lines: [*lines[:4], 7], "line 5 is a value of type int, not text", "type str"),
    "two in one": (
        lambda lines: ["G1 X1\nG1 X2", *lines],
        "line 1 contains a control character",
        "a separate line for each command",
    ),
    "letters": (lambda lines: ["M117 größer", *lines], "line 1 is not a command: 'M117 größer'", "ASCII"),
    "no commands": (lambda _: ["; all", "", "; gone"], "returned 3 lines without a command", "generator"),
}


@pytest.mark.parametrize("case", LINES)
def test_lines_that_no_printer_could_get_are_refused(case: str) -> None:
    function, what, remedy = LINES[case]

    with pytest.raises(ps.StrategyError, match=re.escape(what)) as refused:
        ps.job_of(PART, PROFILE, strategies=ps.Strategies(on_lines=function))

    assert remedy in refused.value.remedy


def test_comments_may_hold_any_letters() -> None:
    job = ps.job_of(PART, PROFILE, strategies=ps.Strategies(on_lines=lambda lines: ["; größer", *lines]))

    assert job.text.startswith("; größer\n".encode())


FLAVOURS: dict[str, tuple[dict[str, Any], str, str]] = {
    "a limit that is text": ({"limits": mine("M203")}, "limits returned a value of type str", "list of str"),
    "an empty command": ({"acceleration": mine("")}, "a line of acceleration is not a command", "ASCII"),
    "progress that is a number": (
        {"progress": lambda percent, _minutes: percent},
        "a line of progress is a value of type int, not text",
        "type str",
    ),
    "labels of no kind": (
        {"labels": "loud"},
        "labels = 'loud' is not a format of object labels",
        "octoprint",
    ),
}


@pytest.mark.parametrize("case", FLAVOURS)
def test_a_flavour_that_says_no_lines_is_refused(case: str) -> None:
    given, what, remedy = FLAVOURS[case]
    profile = ps.profile_with(PROFILE, {"accelerations.external_perimeter": 400, "progress": "true"})
    flavour = replace(ps.FLAVOURS["marlin"], **given)

    with pytest.raises(ps.StrategyError, match=re.escape(what)) as refused:
        ps.job_of(PART, profile, strategies=ps.Strategies(flavour=flavour))

    assert remedy in refused.value.remedy


def test_a_planner_that_calls_ours_and_changes_the_plan_is_fine() -> None:
    def upper_half_thin(part: ps.Mesh, profile: ps.Profile) -> ps.LayerPlan:
        plan = ps.plan_part(part, profile)
        middle = float(plan.top[plan.top <= part.height / 2].max())
        thin = tops(part.moved((0, 0, 0)), profile, 0.1)
        return ps.LayerPlan.from_tops(
            np.concatenate([plan.top[plan.top <= middle], thin[thin > middle + 0.06]])
        )

    part = cone(8, 2, 4)
    stages = ps.slice_stages(part, PROFILE, strategies=ps.Strategies(planner=upper_half_thin))

    assert stages.plan.height[-1] == pytest.approx(0.1)
