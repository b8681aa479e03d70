"""A small share of the hostile bytes of `benchmarks.fuzz_sim`, on every firmware."""

from __future__ import annotations

import pytest

from benchmarks import fuzz_sim
from benchmarks.fuzz_sim import Outcome, main, stream
from benchmarks.sim_grammar import grammar
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.line_reader import LineReader
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.statistics import Statistics

STREAMS = 40


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
def test_hostile_bytes_break_nothing_and_get_only_answers_that_the_firmware_has(name: str) -> None:
    assert sum(stream(name, seed) for seed in range(STREAMS)) > STREAMS


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
def test_what_a_firmware_says_is_narrow(name: str) -> None:
    said = grammar(name)

    assert said.fullmatch("ok") or name == "octoprint virtual"
    for nonsense in ("okay", "hello", "Resend: x", "ok ok", "Traceback", "T:1 /2", "nan"):
        assert not said.fullmatch(nonsense), nonsense


def test_an_answer_that_no_firmware_gives_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedPrinter, "send", lambda self, now: b"odd\n")

    with pytest.raises(Outcome, match="said 'odd'"):
        stream("marlin 2.1", 1)


def test_the_command_tells_what_was_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--streams", "11"]) == 0
    assert "11 streams, 0 of them failed" in capsys.readouterr().out

    def broken(name: str, seed: int) -> int:
        raise ZeroDivisionError(name)

    monkeypatch.setattr(fuzz_sim, "stream", broken)
    assert main(["--streams", "2", "--firmware", "klipper"]) == 1
    assert "firmware 'klipper', seed 1: ZeroDivisionError klipper" in capsys.readouterr().out


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
def test_a_printer_that_is_sent_megabytes_keeps_little(name: str) -> None:
    printer = SimulatedPrinter(Machine(), SIMULATED_FIRMWARES[name], boots=False)
    printer.receive(b"M109 S200\n", 0.0)
    for _ in range(200):
        printer.receive(b"x" * 5000 + b"M105\n" * 200, 0.0)

    assert printer.unread_bytes <= 65_536
    assert printer.report().bytes_lost + printer.report().bytes_flushed > 0


def test_reports_that_nobody_reads_do_not_pile_up() -> None:
    printer = SimulatedPrinter(Machine(), boots=False)
    printer.receive(b"M155 S1\n", 0.0)
    for hour in range(1, 6):
        printer.receive(b"", hour * 3600.0)

    assert len(printer.state.out) < 5000
    assert printer.send(18_000.0).count(b"\n") < 5000


def test_a_line_that_never_ends_is_not_kept() -> None:
    reader = LineReader(SIMULATED_FIRMWARES["klipper"], Statistics())
    for _ in range(1000):
        reader.add_bytes(b"y" * 1000)
        assert reader.next_line() is None

    assert reader.unread_bytes == 0
    reader.add_bytes(b"\n")
    line = reader.next_line()
    assert line is not None
    assert len(line[1]) < 5000


@pytest.mark.parametrize(("name", "seed"), [("reprapfirmware", 218), ("smoothie", 5151)])
def test_names_of_files_that_have_no_capitals_are_said_all_the_same(name: str, seed: int) -> None:
    """A file called \xff: its capital is no single byte."""
    assert stream(name, seed) >= 0
