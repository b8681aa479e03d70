"""What a file says of limits is what the reader and the simulated printer take from it, in every flavour's units."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves, write_gcode
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.motion.rules import MotionLimits, limits_of
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import Profile
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run
from tests.parts import box, plain
from tests.tiny_gcode import commands

ALL = ["max_speed", "max_acceleration", "acceleration", "travel_acceleration"]
TOLD = {
    "marlin": (["jerk", "retract_acceleration", *ALL], "jerk"),
    "marlin_legacy": (["jerk", "retract_acceleration", *ALL], "jerk"),
    "prusa": (["jerk", "retract_acceleration", *ALL], "jerk"),
    "reprapfirmware": (["jerk", *ALL], "jerk"),
    "repetier": (["jerk", "acceleration", "travel_acceleration"], "jerk"),
    "smoothie": (
        ["max_speed", "junction_deviation", "acceleration", "travel_acceleration", "retract_acceleration"],
        "junction_deviation",
    ),
    "klipper": (["acceleration", "travel_acceleration"], "square_corner"),
}
START = {"start_gcode": "G28\nM109 S210", "printer.origin": "corner", "thumbnails": ""}


def wanted(flavour: str) -> Profile:
    speeds = {"max_speed_x": 200, "max_speed_y": 180, "max_speed_z": 8, "max_speed_e": 40}
    most = {"max_acceleration_x": 2000, "max_acceleration_y": 2000, "max_acceleration_z": 90}
    return plain(
        flavour=flavour,
        corner=TOLD[flavour][1],
        acceleration=900,
        travel_acceleration=1100,
        **START,
        **speeds,
        **most,
    )


def halved(limits: MotionLimits, names: list[str]) -> MotionLimits:
    """A machine that was told other limits before."""
    changes: dict[str, Any] = {}
    for name in names:
        value = getattr(limits, name)
        changes[name] = tuple(one / 2 for one in value) if isinstance(value, tuple) else value / 2
    return replace(limits, **changes)


def test_every_flavour_is_looked_at() -> None:
    assert set(TOLD) == set(FLAVOURS)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_reader_takes_the_limits_of_the_file(flavour: str) -> None:
    usual = wanted(flavour)
    limits = limits_of(usual.printer)
    text = write_gcode(slice_part(box((30, 20, 1)), usual), usual)
    moves = read_moves(commands(text), usual.printer.corners[0], FLAVOURS[flavour])

    assert moves.seconds(halved(limits, TOLD[flavour][0])) == pytest.approx(moves.seconds(limits), rel=1e-9)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_simulated_printer_takes_the_limits_of_the_file(flavour: str) -> None:
    usual = wanted(flavour)
    machine = machine_of(usual.printer)
    text = commands(write_gcode(slice_part(box((10, 6, 0.4)), usual), usual))
    seconds = []
    for limits in (machine.limits, halved(machine.limits, TOLD[flavour][0])):
        simulated = SimulatedPrinter(replace(machine, limits=limits), simulated_firmware_for(usual.printer))
        port = VirtualPort(simulated, baud=1_000_000, latency=0.0001)
        run(Streamer(text, limits=limits, window_bytes=127), port, port.now, longest_wait=60)
        assert simulated.report().violations == ()
        seconds.append(simulated.report().print_seconds)

    assert seconds[1] == pytest.approx(seconds[0], rel=1e-6)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_the_times_of_single_moves_add_up_where_limits_change(flavour: str) -> None:
    usual = wanted(flavour)
    limits = limits_of(usual.printer)
    text = write_gcode(slice_part(box((30, 20, 1)), usual), usual)
    middle = len(commands(text)) // 2
    told = [*commands(text)[:middle], b"M203 X20 Y20", b"G4 P500", *commands(text)[middle:]]
    moves = read_moves(told, usual.printer.corners[0], FLAVOURS[flavour])
    total = moves.durations(limits).sum() + moves.dwell_seconds
    assert total == pytest.approx(moves.seconds(limits), rel=1e-9)
