"""Run commands for tests: in this process if that is fast, or in a separate one for signals and pipes."""

from __future__ import annotations

import io
import os
import select
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from time import monotonic
from typing import NamedTuple

from printer_slicer.cli import main
from tests.waiting import LAST_RESORT

ROOT = Path(__file__).parents[2]
PARTS = ROOT / "sample_parts"
BOX = PARTS / "box.stl"
MACHINE = ("--printer", "marlin_220", "--material", "pla")
"""The machine of the flags below, for G-code."""
QUICK = (*MACHINE, "--quality", "standard", "--set", "layer_height=0.3")
"""Flags that do not depend on any default."""


class Outcome(NamedTuple):
    """What a command said and how it ended."""

    code: int
    out: str
    err: str


def typed(*arguments: object, cwd: Path | None = None) -> Outcome:
    """Run a command in this process; neither stdout nor stderr is a terminal."""
    said, complained = io.BytesIO(), io.BytesIO()
    out, err = io.TextIOWrapper(said, "utf-8"), io.TextIOWrapper(complained, "utf-8")
    with redirect_stdout(out), redirect_stderr(err), chdir(cwd or Path.cwd()):
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as leaving:
            code = int(leaving.code or 0)
    for stream in (out, err):
        stream.flush()
    return Outcome(code, said.getvalue().decode(), complained.getvalue().decode())


NO_BUFFER = {"PYTHONUNBUFFERED": "1"}
"""As in many containers: each write goes out at once."""

USUAL = {"PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error", "PYTHONUNBUFFERED": "", "PYTHONIOENCODING": ""}
"""What every process of ours finds in its environment, whatever is set outside."""


def process(
    *arguments: object, cwd: Path, stdout: int = subprocess.PIPE, env: Mapping[str, str] = USUAL
) -> Outcome:
    """Run a command in a process of its own."""
    with started(*arguments, cwd=cwd, stdout=stdout, env=env) as running:
        out, err = running.communicate(timeout=LAST_RESORT)
        return Outcome(running.returncode, (out or b"").decode("utf-8", "replace"), (err or b"").decode())


@contextmanager
def started(
    *arguments: object,
    cwd: Path,
    stdout: int = subprocess.PIPE,
    stderr: int = subprocess.PIPE,
    env: Mapping[str, str] = USUAL,
) -> Iterator[subprocess.Popen[bytes]]:
    """A command that runs while the block does; it is ended after the block if it has not ended by then."""
    running = subprocess.Popen(
        [sys.executable, "-m", "printer_slicer", *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, **USUAL, **env},
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        stderr=stderr,
    )
    try:
        yield running
    finally:
        if running.poll() is None:
            running.kill()
            running.wait(LAST_RESORT)
        for stream in (running.stdout, running.stderr):
            if stream is not None:
                stream.close()


def heard(running: subprocess.Popen[bytes], what: bytes) -> bytes:
    """What a process has written to stdout once `what` is in it."""
    assert running.stdout is not None
    text, end = b"", monotonic() + LAST_RESORT
    while what not in text:
        ready, _, _ = select.select([running.stdout], [], [], max(end - monotonic(), 0.0))
        assert ready, f"{what!r} was not said in time; said: {text!r}"
        piece = os.read(running.stdout.fileno(), 65536)
        assert piece, f"it ended without saying {what!r}; said: {text!r}"
        text += piece
    return text


def is_message(outcome: Outcome, *parts: object) -> bool:
    """Whether stderr is one message for people that has these parts, and neither traceback nor control codes.

    Warnings, and how far a print has come, may stand before it.
    """
    lines = outcome.err.rstrip("\n").split("\n")
    assert [hex(ord(char)) for char in outcome.err if ord(char) < 32 and char != "\n"] == [], repr(
        outcome.err
    )
    assert "Traceback" not in outcome.err, outcome.err
    assert "internal error" not in outcome.err, outcome.err
    assert lines, "nothing was said"
    assert lines[0].startswith("printer-slicer: "), outcome.err
    while len(lines) > 1 and lines[0].startswith(("printer-slicer: warning: ", "printing: ")):
        del lines[0]
    assert [line for line in lines[1:] if not line.startswith("  ")] == [], outcome.err
    missing = [str(part) for part in parts if str(part) not in outcome.err]
    assert missing == [], outcome.err
    return True
