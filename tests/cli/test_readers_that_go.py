"""A reader of stdout or stderr that goes away changes neither what a command finds nor whether a print is finished."""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import pytest

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

import pty

from command_line import BOX, NO_BUFFER, PARTS, QUICK, USUAL, typed

from benchmarks.killing import of_job, served
from printer_slicer.cli.parser import build_parser
from tests.waiting import LAST_RESORT, Halting, hosts, until

REFUSED = "G28\nG1 X50 E5 F3000\n"
"""Extrudes with a cold nozzle."""
LINES = ["G28", "G90", "G1 Z1 F600", *(f"G1 X{10 + i % 60} Y{10 + i % 7} F6000" for i in range(200))]

COMMANDS: Final[dict[str, tuple[object, ...]]] = {
    "slice": ("slice", BOX, "-o", "-", *QUICK),
    "slice what is no model": ("slice", "bad.stl"),
    "slice what is not there": ("slice", "missing.stl", "--json"),
    "plan": ("plan", PARTS / "box.stl", *QUICK),
    "arrange": ("arrange", "missing.stl", "-o", "plate.3mf"),
    "orient": ("orient", "missing.stl"),
    "batch": ("batch", "missing.stl", "--output-dir", "sliced"),
    "contours": ("contours", "missing.stl", "-o", "-"),
    "draw": ("draw", BOX, "-o", "-", *QUICK),
    "check": ("check", "bad.gcode", "--strict", "--printer", "marlin_220"),
    "dry-run a good file": ("dry-run", "good.gcode", "--printer", "marlin_220"),
    "dry-run a bad file": ("dry-run", "bad.gcode", "--printer", "marlin_220"),
    "dry-run a bad file as JSON": ("dry-run", "bad.gcode", "--json", "--printer", "marlin_220"),
    "print a bad file": ("print", "bad.gcode", "--port", "sim:", "--printer", "marlin_220"),
    "print without a printer": ("print", "good.gcode", "--port", "nowhere", "--printer", "marlin_220"),
    "resume": ("resume", "--list"),
    "resume nothing": ("resume",),
    "control": ("control", "abort"),
    "console": ("console", "nowhere"),
    "send": ("send", "missing.gcode", "--to", "octoprint", "http://127.0.0.1:1"),
    "doctor": ("doctor", "nowhere"),
    "sim": ("sim", "--pty", "missing/port"),
    "ports": ("ports",),
    "view": ("view", "missing.gcode"),
    "serve": ("serve", "--listen", "nowhere"),
    "queue": ("queue", "--printers-file", "missing.toml"),
    "profiles": ("profiles", "settings"),
    "profiles that are not there": ("profiles", "show", "no_such_printer"),
    "completion": ("completion", "bash"),
    "man": ("man",),
    "--help": ("--help",),
    "an unknown flag": ("slice", "--no-such-flag"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "bad.gcode").write_text(REFUSED, encoding="utf-8")
    (tmp_path / "good.gcode").write_text("\n".join(LINES) + "\n", encoding="utf-8")
    (tmp_path / "bad.stl").write_bytes(b"solid nothing\nfacet\n")
    return tmp_path


@contextlib.contextmanager
def nobody() -> Iterator[int]:
    """The writing end of a pipe that nobody reads."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        yield writing
    finally:
        os.close(writing)


def unheard(*arguments: object, cwd: Path, buffered: bool) -> int:
    """The exit code of a command whose stdout and stderr nobody reads."""
    env = {**os.environ, **USUAL, **({} if buffered else NO_BUFFER)}
    command = [sys.executable, "-m", "printer_slicer", *map(str, arguments)]
    with nobody() as pipe:
        return subprocess.run(
            command,
            cwd=cwd,
            env=env,
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=pipe,
            timeout=LAST_RESORT,
            check=False,
        ).returncode


def test_every_command_is_tried() -> None:
    (commands,) = (
        action for action in build_parser()._actions if isinstance(action, argparse._SubParsersAction)
    )
    assert set(commands.choices or {}) == {str(words[0]) for words in COMMANDS.values()} - {"--help"}


ALIKE: Final = {
    *("slice what is no model", "slice what is not there", "plan", "contours", "draw", "check"),
    *("dry-run a good file", "dry-run a bad file as JSON", "print without a printer", "send", "doctor"),
}
"""Commands that take as long as others, and write and end as they do."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.thorough if name in ALIKE else ()) for name in COMMANDS],
)
def test_the_verdict_is_the_same_when_nobody_listens(name: str, folder: Path) -> None:
    heard = typed(*COMMANDS[name], cwd=folder)

    assert unheard(*COMMANDS[name], cwd=folder, buffered=False) == heard.code


@pytest.mark.parametrize("name", ["dry-run a bad file", "slice"])
def test_the_verdict_is_the_same_with_a_buffer_that_nobody_empties(name: str, folder: Path) -> None:
    heard = typed(*COMMANDS[name], cwd=folder)

    assert unheard(*COMMANDS[name], cwd=folder, buffered=True) == heard.code


def test_a_refused_file_is_refused_behind_head_too(folder: Path) -> None:
    command = f"'{sys.executable}' -m printer_slicer dry-run bad.gcode --printer marlin_220"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command} | head -1"],
        cwd=folder,
        env={**os.environ, **USUAL, **NO_BUFFER},
        capture_output=True,
        timeout=LAST_RESORT,
        check=False,
    )

    assert done.returncode == 7
    assert b"Traceback" not in done.stderr
    assert b"BrokenPipe" not in done.stderr
    assert b"bad.gcode" in done.stderr


def test_a_command_with_closed_streams_ends_with_its_own_code(folder: Path) -> None:
    command = f"'{sys.executable}' -m printer_slicer dry-run bad.gcode --printer marlin_220 >&- 2>&-"
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, env={**os.environ, **USUAL}, timeout=LAST_RESORT, check=False
    )

    assert done.returncode == 7


# A print


def whole(executed: list[str]) -> bool:
    return of_job(executed) == LINES


@pytest.fixture
def halting() -> Halting:
    """A printer that stands still in the middle of the job."""
    return Halting(lambda lines: len(of_job(lines)) > 50)


def status_of(folder: Path) -> int:
    return typed("control", "status", "--json").code


@pytest.fixture
def state(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(folder / "state"))
    return folder / "state"


@pytest.mark.parametrize("json", [True, False], ids=["JSON", "text"])
def test_a_print_goes_on_when_its_listener_goes(
    json: bool, folder: Path, halting: Halting, state: Path
) -> None:
    command = [sys.executable, "-m", "printer_slicer", "print", "good.gcode", "--port", "port", "-v"]
    command += ["--printer", "marlin_220", *(["--json"] if json else [])]
    pipe = subprocess.PIPE
    env = {**os.environ, **USUAL, **NO_BUFFER}
    with served(folder / "port", 100.0, executed=halting), hosts(state) as started:
        host = subprocess.Popen(command, cwd=folder, env=env, stdin=pipe, stdout=pipe, stderr=pipe)
        started.append(host)
        halting.reached()
        for stream in (host.stdin, host.stdout, host.stderr):
            assert stream is not None
            stream.close()
        halting.go_on()
        code = host.wait(LAST_RESORT)

    assert code == 0
    assert whole(halting)


def hang_up_terminal(folder: Path) -> tuple[int, Callable[[], None]]:
    """A print on a terminal of its own: its process, and what closes that terminal."""
    pid, terminal = pty.fork()
    if pid == 0:  # the process that becomes the command
        os.chdir(folder)
        words = [sys.executable, "-m", "printer_slicer", "print", "good.gcode", "--port", "port"]
        os.execvpe(words[0], [*words, "--printer", "marlin_220"], {**os.environ, **USUAL, "TERM": "xterm"})
    return pid, lambda: os.close(terminal)


def test_a_print_goes_on_when_its_terminal_is_closed(folder: Path, halting: Halting, state: Path) -> None:
    with served(folder / "port", 100.0, executed=halting):
        pid, hang_up = hang_up_terminal(folder)
        try:
            halting.reached()
            hang_up()
            status = status_of(folder)
            halting.go_on()
            until(lambda: whole(halting) or os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT))
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL) if not whole(halting) else None
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])

    assert status == 0
    assert code == 0
    assert whole(halting)
