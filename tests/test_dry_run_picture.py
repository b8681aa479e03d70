"""Pictures of dry runs: the plate around the part, charts over time, text inside the frame."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from printer_slicer.drawing.canvas import Box, Line, Picture, Text, estimate_text_width, wrap_text
from printer_slicer.drawing.dry_run import FaultMark, draw_dry_run
from printer_slicer.inspection.deposition.timeline import TimelineRecorder
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.inspection.dry_run.set_points import find_set_points
from printer_slicer.pipeline import slice_stages
from printer_slicer.slice_jobs import job_of
from tests.parts import box, plain

PROFILE = plain(layer_height=0.3)


@cache
def picture(*found: FaultMark) -> Picture:
    job = job_of(slice_stages(box((12, 12, 3)), PROFILE), PROFILE)
    deposition = dry_run(job, PROFILE).deposition
    assert deposition is not None
    return draw_dry_run(
        deposition,
        find_set_points(job.commands, PROFILE.printer.flavour),
        found,
        title="a box " + "with a long name " * 20,
        corners=PROFILE.printer.corners,
        max_flow=PROFILE.max_flow,
    )


def boxes(name: str) -> list[Box]:
    return [shape for shape in picture().shapes if isinstance(shape, Box) and shape.name == name]


def test_the_plate_is_zoomed_to_the_part_and_the_bed_is_an_inset() -> None:
    plate, bed = boxes("bed")
    (view,) = (shape for shape in picture().shapes if isinstance(shape, Line) and shape.name == "view")
    (x0, y0), (x1, y1) = PROFILE.printer.corners

    assert plate.width > 2 * bed.width
    seen = np.ptp(view.points[:, 0]) / bed.width * (x1 - x0)
    assert 12 < seen < 20
    assert bed.width / bed.height == pytest.approx((x1 - x0) / (y1 - y0))


def test_speed_fan_and_temperatures_have_curves_over_time() -> None:
    texts = [shape.text for shape in picture().shapes if isinstance(shape, Text)]
    curves = [shape for shape in picture().shapes if isinstance(shape, Line) and shape.name == "curve"]

    assert {"mean speed, mm/s", "fan, %", "target temperature, °C", "nozzle", "bed"} <= set(texts)
    assert len(curves) == 4
    assert all(230 <= x <= 930.001 for curve in curves for x in curve.points[:, 0])


def test_no_text_leaves_the_frame() -> None:
    marks = [FaultMark(f"line {k}: " + "something long " * 30, k * 0.1, (500.0, -9.0)) for k in range(12)]
    made = picture(*marks)
    for text in (shape for shape in made.shapes if isinstance(shape, Text)):
        wide = estimate_text_width(text.text, text.size)
        left = text.x - {"start": 0.0, "middle": wide / 2, "end": wide}[text.anchor]
        assert left >= 0
        assert left + wide <= made.width + 4
        assert 0 <= text.y <= made.height


def test_set_points_are_those_that_the_commands_set() -> None:
    commands = [b"M104 S200", b"G1 X1", b"M140 S60", b"M106 S127.5", b"M107"]
    points = find_set_points(commands, "marlin")

    assert points.command.tolist() == [1, 1, 3, 4, 5]
    assert points.nozzle.tolist() == [0, 200, 200, 200, 200]
    assert points.bed.tolist() == [0, 0, 60, 60, 60]
    assert points.fan.tolist() == [0, 0, 0, 50, 0]


def test_the_timeline_keeps_distance_and_time_however_long_the_print_is() -> None:
    recorder, rng = TimelineRecorder(), np.random.default_rng(3)
    total = distance = 0.0
    for first in range(1, 9000, 500):
        rows = np.zeros((500, 9))
        rows[:, 0] = np.arange(first, first + 500)
        rows[:, 4] = rng.uniform(0, 30, 500)
        seconds = rng.uniform(0.01, 3, 500)
        recorder.add_moves(rows, seconds)
        total, distance = total + float(seconds.sum()), distance + float(rows[:, 4].sum())
    line = recorder.close()

    assert line.seconds - line.step < total <= line.seconds
    assert len(line.speed) <= 1024
    full = line.speed[:-1].sum() * line.step + line.speed[-1] * (total - line.step * (len(line.speed) - 1))
    assert full == pytest.approx(distance)
    assert (np.diff(line.command) >= 0).all()
    assert line.time_of(np.array([4500]))[0] == pytest.approx(total / 2, rel=0.1)


def test_texts_are_wrapped_within_their_room() -> None:
    lines = wrap_text("one two three four five six seven", 10, 80)

    assert len(lines) == 2
    assert all(estimate_text_width(line, 10) <= 80 for line in lines)
    assert lines[1].endswith("…")
