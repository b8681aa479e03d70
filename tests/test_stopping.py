"""A print that is stopped while the printer homes or heats ends soon, and cold."""

from __future__ import annotations

import pytest

from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.profile import load_profile
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.statistics import Report
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.states import State

JOB = [b"G28", b"M190 S60", b"M109 S215", *(b"G1 X%d F3000" % x for x in range(1, 50))]
OFF = [b"M104 S0", b"M140 S0", b"M107"]


def stopped(job: list[bytes], after: float) -> tuple[Streamer, float, Report]:
    """The host, how long it took to the end, and the printer's account, for a print cancelled after so many seconds."""
    printer = load_profile(slices=False).printer
    simulated = SimulatedPrinter(machine_of(printer), simulated_firmware_for(printer))
    port = VirtualPort(simulated, baud=115200, latency=0.001)
    streamer = Streamer(job)
    cancelled = 0.0
    while not streamer.done:
        port.write(streamer.send(port.now()))
        streamer.events()
        streamer.receive(port.read(0.25), port.now())
        if not cancelled and port.now() >= after:
            cancelled = port.now()
            streamer.cancel(OFF)
    return streamer, port.now() - cancelled, simulated.report()


@pytest.mark.parametrize(
    ("after", "coldest"),
    [(1.5, 30.0), (3.0, 30.0), (6.0, 30.0), (60.0, 30.0)],
    ids=["homing", "homing still", "bed", "bed long"],
)
def test_a_stop_during_homing_or_heating_does_not_heat_on(after: float, coldest: float) -> None:
    streamer, seconds, report = stopped(JOB, after)

    assert streamer.state is State.DONE
    assert seconds < 15.0
    assert report.peak_hotend < coldest


def test_two_waits_one_behind_the_other_are_both_broken_off() -> None:
    _, seconds, report = stopped([b"M190 S60", b"M109 S215", b"G1 X5 F3000"], 4.0)

    assert seconds < 15.0
    assert report.peak_hotend < 60.0


def test_a_stop_while_printing_ends_with_what_was_planned() -> None:
    streamer, seconds, report = stopped([b"M302 P1", *JOB[3:] * 20], 20.0)

    assert streamer.acknowledged < 49 * 20
    assert seconds < 10.0
    assert report.lines < 49 * 20 + 20
