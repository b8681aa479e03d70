"""Printing by command: over the simulated port, over a pseudo-terminal, interrupted, halted, unplugged."""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from random import Random  # noqa: TID251 - seeded
from threading import Event as Flag
from threading import Thread
from typing import Any

import pytest
import serial
from command_line import (
    BOX,
    MACHINE,
    NO_BUFFER,
    PARTS,
    QUICK,
    USUAL,
    heard,
    is_message,
    process,
    started,
    typed,
)

from printer_slicer.commands import split_gcode
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.profile import load_profile
from printer_slicer.sim.link import Cable, CableNoise
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

import pty
import tty

PRINTER = load_profile("marlin_220").printer
DANCE = "".join(f";LAYER_CHANGE\nG1 X{10 + i % 7} Y{5 + i % 3} F600\nG1 X{20 + i % 5}\n" for i in range(2000))
LONG = "M104 S200\nM140 S60\nG28\n" + DANCE
"""Some seconds of real time at the speed at which the printer below runs."""


@contextmanager
def printer(
    link: Path, *, speed: float = 0, connect: Callable[[SimulatedPrinter], Cable] = Cable
) -> Iterator[list[str]]:
    """A simulated printer under the name `link`; the list holds what it executes, as it does."""
    ready, stop = Flag(), Flag()
    executed: list[str] = []

    def make() -> SimulatedPrinter:
        return SimulatedPrinter(
            machine_of(PRINTER), simulated_firmware_for(PRINTER), on_executed=executed.append
        )

    thread = Thread(
        target=lambda: serve(
            make, link, speed=speed, connect=connect, stop=stop.is_set, ready=lambda _: ready.set()
        )
    )
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield executed
    finally:
        stop.set()
        thread.join(LAST_RESORT)
    assert not thread.is_alive()


def events(text: str) -> list[dict[str, Any]]:
    """One event per line, each a JSON object with a name; numbers that JSON does not know are refused."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    found = [json.loads(line, parse_constant=refuse) for line in text.splitlines()]
    assert all(isinstance(event["event"], str) for event in found)
    return found


def checkpoint_in(folder: Path) -> dict[str, Any]:
    """The one checkpoint that was written."""
    (path,) = folder.glob("*.checkpoint.json")
    return dict(json.loads(path.read_text(encoding="utf-8")))


def wishes(lines: list[str]) -> list[str]:
    """What was executed of the job: not what the host asks on its own account."""
    return [line for line in lines if not line.startswith(("M105", "M110", "M114", "M115", "M155", "M400"))]


# The simulated port


def test_printing_on_the_simulated_port_ends_with_a_verdict(tmp_path: Path) -> None:
    outcome = typed("print", BOX, "--port", "sim:", *QUICK, cwd=tmp_path)

    assert (outcome.code, outcome.err) == (0, "")
    assert "in order" in outcome.out
    assert "layers      34, first " in outcome.out
    assert list(tmp_path.iterdir()) == []


def test_printing_on_the_simulated_port_tells_events_as_json_lines(tmp_path: Path) -> None:
    outcome = typed("print", BOX, "--port", "sim:", "--json", *QUICK, cwd=tmp_path)
    told = events(outcome.out)
    verdict, progress = told[-1], [event for event in told if event["event"] == "progress"]
    plastic = [z for z in verdict["heights"] if z in verdict["planned"]]

    assert (outcome.code, outcome.err) == (0, "")
    assert verdict["event"] == "verdict"
    assert verdict["ok"] is verdict["executed_equals_sent"] is verdict["heights_equal_plan"] is True
    assert plastic == [round(z, 4) for z in verdict["planned"]]
    assert [event["done"] for event in progress] == sorted({event["done"] for event in progress})
    assert progress[-1]["done"] == progress[-1]["total"] == verdict["commands"]
    assert {"temperature", "identified", "finished"} <= {event["event"] for event in told}
    assert len(progress) <= 101


def test_a_file_that_must_not_be_printed_ends_with_7_on_the_simulated_port(tmp_path: Path) -> None:
    (tmp_path / "cold.gcode").write_text("G28\nG1 X50 E5 F3000\n", encoding="utf-8")
    allowed = ("--allow", "cold")
    outcome = typed("print", "cold.gcode", "--port", "sim:", "--json", *allowed, *MACHINE, cwd=tmp_path)

    assert outcome.code == 7
    assert events(outcome.out)[-1]["ok"] is False
    assert is_message(outcome, "cold.gcode")


# A port


def test_printing_a_part_on_a_served_printer_executes_it_once_and_in_order(tmp_path: Path) -> None:
    with printer(tmp_path / "port") as executed:
        outcome = typed("print", BOX, "--port", "port", "--json", *QUICK, cwd=tmp_path)
    text = typed("slice", BOX, "-o", "-", *QUICK).out
    told = events(outcome.out)

    assert (outcome.code, outcome.err) == (0, "")
    assert wishes(executed) == [command.decode() for command in split_gcode(text.encode()).commands]
    assert (told[-1]["event"], told[-1]["verified"]) == ("finished", True)
    assert list(tmp_path.iterdir()) == []


def test_the_printer_that_is_served_by_command_executes_what_is_sent(tmp_path: Path) -> None:
    """Two processes, as people use them; the report of the one is compared with the file of the other."""
    typed("slice", BOX, "-o", "box.gcode", *QUICK, cwd=tmp_path)
    commands = split_gcode((tmp_path / "box.gcode").read_bytes()).commands
    flags = ("--pty", "port", "--speed", "0", "--report", "report.json", "--printer", "marlin_220")
    with started("sim", *flags, cwd=tmp_path) as serving:
        heard(serving, b"ends it")
        outcome = typed("print", "box.gcode", "--port", "port", "-q", *MACHINE, cwd=tmp_path)
        serving.send_signal(signal.SIGTERM)
        out, err = serving.communicate(timeout=LAST_RESORT)
    report = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))

    assert (outcome.code, outcome.err) == (0, "")
    assert (serving.returncode, err) == (0, b"")
    assert report["job_commands"] == len(commands)
    assert report["job_digest"] == sha256(b"".join(command + b"\n" for command in commands)).hexdigest()
    assert report["n_violations"] == 0
    assert f"executed {len(commands)} commands".encode() in out
    assert not (tmp_path / "port").is_symlink()


def test_the_served_printer_ends_at_ctrl_c_too_and_tells_its_report_as_json(tmp_path: Path) -> None:
    with started("sim", "--pty", "port", "--speed", "0", "--json", cwd=tmp_path) as serving:
        appears(tmp_path / "port")
        with serial.Serial(str(tmp_path / "port"), timeout=LAST_RESORT) as port:
            port.write(b"M105\n")
            while not port.readline().startswith(b"ok"):
                assert serving.poll() is None
        serving.send_signal(signal.SIGINT)
        out, err = serving.communicate(timeout=LAST_RESORT)

    assert (serving.returncode, err) == (0, b"")
    assert json.loads(out)["job_commands"] == 0


def appears(path: Path) -> None:
    """Wait until there is such a file."""
    until(path.exists, lambda: path)


def test_a_served_printer_that_is_terminated_early_still_ends_well(tmp_path: Path) -> None:
    with started("sim", "--pty", "port", "-q", cwd=tmp_path) as serving:
        appears(tmp_path / "port")
        serving.terminate()
        out, err = serving.communicate(timeout=LAST_RESORT)

    assert (serving.returncode, out, err) == (0, b"", b"")
    assert not (tmp_path / "port").is_symlink()


def test_a_port_that_somebody_else_prints_on_is_a_port_error(tmp_path: Path) -> None:
    with printer(tmp_path / "port"), serial.Serial(str(tmp_path / "port"), exclusive=True):
        outcome = typed("print", BOX, "--port", "port", "-q", *QUICK, cwd=tmp_path)

    assert outcome.code == 4
    assert is_message(outcome, "port is in use", "Close the other program")


# Not to the end


def test_what_a_printer_says_never_controls_the_terminal(tmp_path: Path) -> None:
    """The reason of a failure is text from outside; its escape codes must not reach the terminal."""
    master, slave = pty.openpty()
    tty.setraw(slave)

    def halt() -> None:
        assert select.select([master], [], [], LAST_RESORT)[0], "nobody greets"
        os.write(master, b"Error:\x1b]0;title\x07\x1b[2JPrinter halted. kill() called!\n")

    thread = Thread(target=halt)
    thread.start()
    outcome = typed("print", BOX, "--port", os.ttyname(slave), "-q", *QUICK, cwd=tmp_path)
    thread.join(LAST_RESORT)
    os.close(master)
    os.close(slave)

    assert outcome.code == 5
    assert is_message(outcome, "box.stl", "halted")


def test_a_printer_that_halts_ends_the_print_with_5_and_a_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text("G28\n" + DANCE[:4000] + "\nM112\n" + DANCE, encoding="utf-8")
    with printer(tmp_path / "port"):
        outcome = typed("print", "job.gcode", "--port", "port", "--allow", "halt", *MACHINE, cwd=tmp_path)
    checkpoint = checkpoint_in(tmp_path)

    assert outcome.code == 5
    assert is_message(
        outcome, "job.gcode", "halted", "job.checkpoint.json", f"after {checkpoint['acknowledged']} of"
    )
    assert 0 < checkpoint["acknowledged"] < checkpoint["commands"]
    assert checkpoint["layer"] > 0
    assert "halted" in checkpoint["reason"]


def test_a_port_that_vanishes_ends_the_print_with_5_and_a_checkpoint(tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text(LONG, encoding="utf-8")
    with started("sim", "--pty", "port", "--speed", "0", cwd=tmp_path) as serving:
        heard(serving, b"ends it")
        with started(
            "print", "job.gcode", "--port", "port", "--json", "--reconnect", "1", *MACHINE, cwd=tmp_path
        ) as printing:
            said = heard(printing, b'"event": "progress"')
            serving.kill()  # as pulling the plug: nobody says goodbye
            out, err = printing.communicate(timeout=LAST_RESORT)
    checkpoint = checkpoint_in(tmp_path)

    assert printing.returncode == 5, err
    assert b"Traceback" not in err
    assert f"after {checkpoint['acknowledged']} of {checkpoint['commands']} commands" in err.decode()
    assert b"cable" in err
    assert 0 < checkpoint["acknowledged"] < checkpoint["commands"]
    assert events((said + out).decode())


@pytest.mark.parametrize("env", [USUAL, NO_BUFFER], ids=["buffered", "unbuffered"])
def test_ctrl_c_ends_the_print_with_6_and_turns_the_heaters_off(env: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text(LONG, encoding="utf-8")
    flags = ("--json", *MACHINE)
    with (
        printer(tmp_path / "port", speed=100) as executed,
        started("print", "job.gcode", "--port", "port", *flags, cwd=tmp_path, env=env) as printing,
    ):
        said = heard(printing, b'"layer": 2')
        printing.send_signal(signal.SIGINT)
        out, err = printing.communicate(timeout=LAST_RESORT)
    commands = [command.decode() for command in split_gcode(LONG.encode()).commands]
    checkpoint = checkpoint_in(tmp_path)
    done, lines = checkpoint["acknowledged"], wishes(executed)

    assert printing.returncode == 6, err
    assert b"Traceback" not in err
    assert f"after {done} of {len(commands)} commands, in layer {checkpoint['layer']}" in err.decode()
    assert b"job.checkpoint.json" in err
    assert 3 < done < len(commands)
    assert lines[:done] == commands[:done]
    assert {"M104 S0", "M140 S0"} <= set(lines[done:])
    assert not set(lines[done:]) & set(commands)
    assert events((said + out).decode())[-1]["event"] == "finished"


def test_ctrl_c_before_the_printer_answers_is_a_cancelled_print(tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text(LONG, encoding="utf-8")
    master, slave = pty.openpty()
    tty.setraw(slave)
    with started("print", "job.gcode", "--port", os.ttyname(slave), *MACHINE, cwd=tmp_path) as printing:
        assert select.select([master], [], [], LAST_RESORT)[0], "it never greets"
        printing.send_signal(signal.SIGINT)
        _, err = printing.communicate(timeout=LAST_RESORT)
    os.close(master)
    os.close(slave)

    assert printing.returncode == 6, err
    assert b"Traceback" not in err


def test_a_computer_that_shuts_down_leaves_no_heater_on(tmp_path: Path) -> None:
    """A print must not end with a hot nozzle in the part."""
    (tmp_path / "job.gcode").write_text(LONG, encoding="utf-8")
    with (
        printer(tmp_path / "port", speed=100) as executed,
        started("print", "job.gcode", "--port", "port", "--json", *MACHINE, cwd=tmp_path) as printing,
    ):
        heard(printing, b'"event": "progress"')
        printing.send_signal(signal.SIGTERM)
        printing.communicate(timeout=LAST_RESORT)

    assert printing.returncode == 6
    assert {"M104 S0", "M140 S0"} <= set(executed)


def test_a_checkpoint_of_an_earlier_failure_is_gone_after_a_good_print(tmp_path: Path) -> None:
    """Else the next person takes a finished print for one to be looked after."""
    (tmp_path / "job.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    (tmp_path / "job.checkpoint.json").write_text('{"job": "job.gcode"}\n', encoding="utf-8")
    with printer(tmp_path / "port"):
        outcome = typed("print", "job.gcode", "--port", "port", *MACHINE, cwd=tmp_path)

    assert outcome.code == 0
    assert not (tmp_path / "job.checkpoint.json").exists()


def test_a_printer_that_is_not_where_the_job_ends_fails_with_7(tmp_path: Path) -> None:
    """It took every line, but its firmware stops at the end of the axis."""
    (tmp_path / "low.gcode").write_text("G28\nG90\nG1 X-20 F3000\n", encoding="utf-8")
    with printer(tmp_path / "port"):
        outcome = typed("print", tmp_path / "low.gcode", "--port", tmp_path / "port", "--allow", "box")

    assert outcome.code == 7
    assert "the printer is NOT at the end position of the job" in outcome.out
    assert outcome.err.endswith(
        "printer-slicer: low.gcode: the printer accepted all commands, but is not at the end position of the job\n"
        "  Inspect the part: commands were lost on the cable, or moves were outside the printer's limits\n"
    )


# The served printer refuses what cannot be


def test_the_simulated_printer_refuses_a_name_that_is_taken(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine", encoding="utf-8")
    outcome = process("sim", "--pty", "taken", cwd=tmp_path)

    assert outcome.code == 4
    assert is_message(outcome, "taken")
    assert (tmp_path / "taken").read_text(encoding="utf-8") == "mine"


def test_a_printer_is_simulated_even_if_the_default_quality_does_not_suit_it(tmp_path: Path) -> None:
    fine = (
        'inherits = "marlin_220"\nname = "fine"\nnozzle_diameter = 0.2\nmin_layer = 0.04\nmax_layer = 0.14\n'
    )
    (tmp_path / "fine.toml").write_text(fine, encoding="utf-8")
    with started("sim", "--pty", "printer", "--printer", "fine.toml", cwd=tmp_path) as running:
        assert running.stdout is not None
        said = running.stdout.readline()

    assert b"simulated fine" in said


def test_the_simulated_printer_refuses_a_folder_that_is_not_there(tmp_path: Path) -> None:
    outcome = process("sim", "--pty", "missing/printer", cwd=tmp_path)

    assert outcome.code == 4
    assert is_message(outcome, "missing/printer")


@pytest.mark.parametrize("speed", ["-1", "nan", "-0.5"])
def test_the_simulated_printer_refuses_a_speed_that_makes_no_sense(speed: str, tmp_path: Path) -> None:
    with started("sim", "--pty", "printer", f"--speed={speed}", cwd=tmp_path) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"", "it serves"
        _, err = running.communicate(timeout=LAST_RESORT)

    assert running.returncode == 2
    assert b"--speed" in err


def test_the_simulated_printer_refuses_a_report_that_cannot_be_written_before_it_serves(
    tmp_path: Path,
) -> None:
    """At the end of a long print is too late to learn that the report has no place."""
    with started("sim", "--pty", "printer", "--report", "missing/report.json", cwd=tmp_path) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == b"", "it serves"
        _, err = running.communicate(timeout=LAST_RESORT)

    assert running.returncode == 2
    assert b"missing/report.json" in err


@pytest.mark.parametrize(("expected", "code"), [("box.stl", 0), ("bridge.stl", 7)])
def test_the_served_printer_judges_what_it_was_to_print(expected: str, code: int, tmp_path: Path) -> None:
    """Through a pseudo-terminal and the serial library: executed = sent, heights as planned, time as modelled."""
    flags = ("--pty", "port", "--speed", "0", "--expect", PARTS / expected, "--json")
    with started("sim", *flags, cwd=tmp_path) as serving:
        until(lambda: (tmp_path / "port").is_symlink() or serving.poll() is not None)
        printed = typed("print", PARTS / "box.stl", "--port", tmp_path / "port", cwd=tmp_path)
        serving.terminate()
        out, _ = serving.communicate(timeout=LAST_RESORT)
    verdict = json.loads(out)["verdict"]

    assert printed.code == 0
    assert serving.returncode == code
    assert verdict["ok"] == verdict["executed_equals_sent"] == verdict["heights_equal_plan"] == (code == 0)
    if not code:
        assert verdict["simulated_seconds"] == pytest.approx(verdict["modelled_seconds"], rel=0.01)


# A bad cable


@pytest.mark.parametrize("json_", [False, True], ids=["for people", "json"])
def test_a_print_over_a_bad_cable_says_so_while_it_runs_and_at_its_end(tmp_path: Path, json_: bool) -> None:
    job = tmp_path / "dance.gcode"
    job.write_text("G28\n" + DANCE[: len(DANCE) // 6], encoding="utf-8")

    def bad(printer: SimulatedPrinter) -> Cable:
        return Cable(printer, noise=CableNoise(Random(3), flip=1e-3))

    with printer(tmp_path / "port", connect=bad):
        options = ["--json"] if json_ else []
        outcome = typed(
            "print", job, "--port", tmp_path / "port", "--printer", "marlin_220", *options, cwd=tmp_path
        )

    assert outcome.code == 0, outcome.err
    if json_:
        told = events(outcome.out)
        warnings = [event for event in told if event["event"] == "poor_link"]
        last = told[-1]["link"]["warning"]
        assert warnings
        assert warnings[0]["resends"] + warnings[0]["lost_answers"] <= last["resends"] + last["lost_answers"]
        assert last["resends_per_1000"] > 2.0
    else:
        warnings = [line for line in outcome.err.splitlines() if line.startswith("warning: ")]
        assert len(warnings) >= 2
        assert all("cable" in line for line in warnings), warnings
        assert "per 1000 lines" in warnings[-1]
