"""The console: lines go out one by one, answers are shown, a person and a pipe."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import pytest
from command_line import PARTS, Outcome, typed

from tests.waiting import LAST_RESORT

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

from printer_slicer.cli.commands.console import Console
from printer_slicer.errors import PortError, UsageError
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.profile import load_profile
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.stream.serial_port import open_port

PRINTER = load_profile("marlin_220").printer


@contextmanager
def served(link: Path) -> Iterator[list[str]]:
    ready, stop = Flag(), Flag()
    executed: list[str] = []

    def make() -> SimulatedPrinter:
        return SimulatedPrinter(
            machine_of(PRINTER), simulated_firmware_for(PRINTER), on_executed=executed.append, boots=False
        )

    thread = Thread(target=lambda: serve(make, link, speed=0, stop=stop.is_set, ready=lambda _: ready.set()))
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield executed
    finally:
        stop.set()
        thread.join(LAST_RESORT)


def test_commands_of_the_command_line_are_sent_in_order_and_answered(tmp_path: Path) -> None:
    with served(tmp_path / "port") as executed:
        outcome = typed("console", tmp_path / "port", "--command", "G28", "--command", "M114 ; where")

    assert outcome.code == 0, outcome.err
    assert executed == ["G28", "M114"]
    assert [line[:5] for line in outcome.out.splitlines() if "busy" not in line] == [
        "X:0.0",
        "ok",
        "X:0.0",
        "ok",
    ]


def piped(text: str, *arguments: object, monkeypatch: pytest.MonkeyPatch) -> Outcome:
    monkeypatch.setattr(sys, "stdin", StringIO(text))
    return typed("console", *arguments)


def test_a_pipe_is_sent_line_by_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(tmp_path / "port") as executed:
        outcome = piped(
            "M118 one\n\n; note\n.temp\n.quit\nM118 two\n", tmp_path / "port", monkeypatch=monkeypatch
        )

    assert outcome.code == 0, outcome.err
    assert executed == ["M118 one", "M105"]
    assert outcome.out.startswith("one\nok\nok T:21.00")


def test_the_log_holds_both_sides(tmp_path: Path) -> None:
    with served(tmp_path / "port"):
        typed("console", tmp_path / "port", "--command", "M118 hello", "--log", tmp_path / "log")

    assert (tmp_path / "log").read_text(encoding="utf-8") == "> M118 hello\n< hello\n< ok\n"


def test_a_log_that_cannot_be_written_is_told_before_the_port_is_opened(tmp_path: Path) -> None:
    log = tmp_path / "missing" / "log"
    outcome = typed("console", tmp_path / "nowhere", "--log", log)

    assert (outcome.code, outcome.err) == (
        2,
        f"printer-slicer: {log}: cannot be written: No such file or directory\n  Choose another file with --log\n",
    )


def test_an_emergency_stop_waits_for_nothing_and_a_dead_printer_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served(tmp_path / "port"):
        outcome = piped(".abort\nM105\n", tmp_path / "port", monkeypatch=monkeypatch)

    assert outcome.code == 4
    assert "has halted" in outcome.err


def test_what_cannot_be_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(tmp_path / "port") as executed:
        assert piped("M117 " + "x" * 200, tmp_path / "port", monkeypatch=monkeypatch).code == 2
        assert piped(".dance\n", tmp_path / "port", monkeypatch=monkeypatch).code == 2
    assert executed == []
    assert typed("console", tmp_path / "nowhere").code == 4


def test_what_would_harm_the_machine_is_refused_unless_it_is_allowed(tmp_path: Path) -> None:
    with served(tmp_path / "port") as executed:
        hot = typed("console", tmp_path / "port", "--command", "M104 S500")
        high = typed(
            "console",
            tmp_path / "port",
            "--command",
            "M104 S260",
            "--set",
            "printer.max_nozzle_temperature=250",
        )
        stored = typed("console", tmp_path / "port", "--command", "M117 a", "--command", "M500")
        allowed = typed("console", tmp_path / "port", "--command", "M500", "--allow", "eeprom")
        slip = typed("console", tmp_path / "port", "--command", "M117 b", "--allow", "eprom")

    assert (hot.code, high.code, stored.code, slip.code) == (2, 2, 2, 2)
    assert "[temperature]" in hot.err
    assert "--allow NAME" in hot.err
    assert "[eeprom]" in stored.err
    assert allowed.code == 0, allowed.err
    assert executed == ["M117 a", "M500"]


def test_units_and_modes_of_earlier_lines_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(tmp_path / "port") as executed:
        beside = piped("G28\nG20\nG1 X50\n", tmp_path / "port", monkeypatch=monkeypatch)
        inside = piped("G28\nG21\nG1 X50\n", tmp_path / "port", monkeypatch=monkeypatch)

    assert (beside.code, inside.code) == (2, 0)
    assert "[box]" in beside.err
    assert executed == ["G28", "G20", "G28", "G21", "G1 X50"]


def test_a_person_types_a_refused_line_once_more_to_send_it(tmp_path: Path) -> None:
    with served(tmp_path / "port") as executed:
        port = open_port(str(tmp_path / "port"))
        console = Console(port, allow=lambda command: "it writes the EEPROM" if command == b"M500" else "")
        with pytest.raises(UsageError, match="Type the same line again"):
            console.send_line("M500", is_interactive=True)
        console.send_line("M117 no", is_interactive=True)
        with pytest.raises(UsageError, match="Type the same line again"):
            console.send_line("M500", is_interactive=True)
        console.send_line("M500 ; yes", is_interactive=True)
        port.close()
    assert executed == ["M117 no", "M500"]


def test_a_policy_can_refuse_a_command(tmp_path: Path) -> None:
    with served(tmp_path / "port") as executed:
        port = open_port(str(tmp_path / "port"))
        console = Console(port, allow=lambda command: "it writes the EEPROM" if command == b"M500" else "")
        with pytest.raises(UsageError, match="EEPROM"):
            console.send_line("M500")
        port.close()
    assert executed == []


def test_a_printer_that_says_nothing_is_not_waited_for(tmp_path: Path) -> None:
    with served(tmp_path / "port"):
        port = open_port(str(tmp_path / "port"))
        console = Console(port, timeout=0.3)
        console.send_line(".stop")
        port.read(0.5)
        with pytest.raises(PortError, match="no reply"):
            console.send_line("M105")
        port.close()


def test_the_simulated_port_is_explained_where_it_does_not_work(tmp_path: Path) -> None:
    for command in (("console",), ("doctor",), ("print", PARTS / "box.stl", "--port")):
        for port in ("sim",) if "--port" in command else ("sim", "sim:"):
            outcome = typed(*command, port, cwd=tmp_path)

            assert outcome.code == 4
            said = "Did you mean sim:" if port == "sim" else "sim --pty /tmp/printer"
            assert said in outcome.err
            assert len(outcome.err.splitlines()) == 2
