"""The pump: what it writes, how long it waits, and that it can be left and entered again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from printer_slicer.errors import PortError
from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Accepted, Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import Transport, run
from printer_slicer.stream.states import State

JOB = [b"G28", b"G90", *(b"G1 X%d Y%d F6000" % (i % 90 + 5, i % 50 + 5) for i in range(40)), b"M104 S0"]
END_SCRIPT = [b"M104 S0", b"M140 S0", b"M107"]


class Recorder:
    """A transport that remembers, and can be made to fail at its n-th reading."""

    def __init__(self, port: VirtualPort, *, fails_at: int = -1, error: BaseException | None = None) -> None:
        self.written = b""
        self.waits: list[float] = []
        self._port = port
        self._fails_at = fails_at
        self._error = error

    def write(self, data: bytes) -> None:
        self.written += data
        self._port.write(data)

    def read(self, timeout: float) -> bytes:
        self.waits.append(timeout)
        if self._error is not None and len(self.waits) == self._fails_at:
            raise self._error
        return self._port.read(timeout)

    def close(self) -> None:
        self._port.close()


def printer() -> tuple[SimulatedPrinter, list[str]]:
    executed: list[str] = []
    return SimulatedPrinter(Machine(), MARLIN_2_1, on_executed=executed.append), executed


def motion(executed: list[str]) -> list[str]:
    return [line for line in executed if line.startswith("G")]


def test_a_job_is_run_to_its_end_and_told_step_by_step() -> None:
    simulated, executed = printer()
    port = VirtualPort(simulated, latency=0.001)
    transport: Transport = Recorder(port)
    events: list[Event] = []

    run(Streamer(JOB), transport, port.now, on_event=events.append)
    transport.close()

    assert motion(executed) == [line.decode() for line in JOB if line.startswith(b"G")]
    assert [e.acknowledged for e in events if isinstance(e, Accepted)][-1] == len(JOB)
    assert isinstance(events[-1], Finished)
    assert events[-1].verified


def test_it_never_waits_so_long_that_a_wish_of_another_thread_goes_unheard() -> None:
    simulated, _ = printer()
    port = VirtualPort(simulated)
    recorder = Recorder(port)

    run(Streamer([*JOB, b"G4 S30"]), recorder, port.now, longest_wait=0.02)

    assert max(recorder.waits) == 0.02
    assert min(recorder.waits) >= 0.0


def test_ctrl_c_then_cancel_runs_the_end_script_and_skips_the_rest() -> None:
    simulated, executed = printer()
    port = VirtualPort(simulated, latency=0.001)
    streamer = Streamer(JOB)
    events: list[Event] = []

    with pytest.raises(KeyboardInterrupt):
        run(streamer, Recorder(port, fails_at=40, error=KeyboardInterrupt()), port.now)
    streamer.cancel(END_SCRIPT)
    run(streamer, Recorder(port), port.now, on_event=events.append)

    assert executed[-6:] == ["M104 S0", "M140 S0", "M107", "M400", "M105", "M114"]
    moves = motion(executed)
    assert moves == [line.decode() for line in JOB[: len(moves)]]
    assert len(moves) < len(JOB) - 1
    assert isinstance(events[-1], Finished)
    assert events[-1].cancelled
    assert events[-1].acknowledged == len(moves)


def test_bytes_cut_off_by_ctrl_c_are_found_missing_and_sent_again() -> None:
    simulated, executed = printer()
    port = VirtualPort(simulated, latency=0.001)
    streamer = Streamer(JOB)
    with pytest.raises(KeyboardInterrupt):
        run(streamer, Recorder(port, fails_at=40, error=KeyboardInterrupt()), port.now)

    streamer.receive(b"ok\n", port.now())
    assert streamer.send(port.now())  # never written
    run(streamer, Recorder(port), port.now)

    assert streamer.state is State.DONE
    assert motion(executed) == [line.decode() for line in JOB if line.startswith(b"G")]


def test_an_event_may_stop_the_printer() -> None:
    simulated, executed = printer()
    port = VirtualPort(simulated)
    recorder = Recorder(port)
    streamer = Streamer(JOB)

    def stop(event: Event) -> None:
        if isinstance(event, Accepted) and event.acknowledged == 20:
            streamer.emergency_stop()

    run(streamer, recorder, port.now, on_event=stop)

    assert streamer.state is State.HALTED
    assert recorder.written.endswith(b"\nM112\n")
    assert len(motion(executed)) <= 24
    port.read(0.0)
    assert simulated.report().killed


def test_an_emergency_parser_stops_even_a_printer_that_is_busy() -> None:
    simulated = SimulatedPrinter(Machine(), replace(MARLIN_2_1_ADVANCED, wait_seconds=0.0))
    port = VirtualPort(simulated)
    streamer = Streamer([b"G4 S100", b"G28"])
    with pytest.raises(KeyboardInterrupt):
        run(streamer, Recorder(port, fails_at=4, error=KeyboardInterrupt()), port.now)

    streamer.emergency_stop()
    run(streamer, port, port.now)
    port.read(0.0)

    assert simulated.report().killed
    assert port.now() < 1.0


def test_a_cable_that_is_pulled_ends_it_with_the_lines_counted() -> None:
    simulated, _ = printer()
    port = VirtualPort(simulated)
    streamer = Streamer(JOB)

    with pytest.raises(PortError, match="gone"):
        run(streamer, Recorder(port, fails_at=40, error=PortError("the port is gone")), port.now)

    assert 10 < streamer.acknowledged < len(JOB)


def test_a_printer_that_never_answers_is_given_up() -> None:
    simulated, executed = printer()
    port = VirtualPort(simulated, noise=lambda _, __: b"")
    streamer = Streamer(JOB)
    events: list[Event] = []

    run(streamer, port, port.now, on_event=events.append)

    assert executed == []
    assert isinstance(events[-1], Halted)
    assert port.now() == pytest.approx(30.0, abs=1.0)
