"""`console`: a person, or a pipe, talks to a printer."""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import IO, TYPE_CHECKING, Final

from printer_slicer.cli.arguments import add_machine, add_output, number, positive
from printer_slicer.cli.output import visible
from printer_slicer.cli.settings import profile_from
from printer_slicer.errors import OutputError, PortError, UsageError

if TYPE_CHECKING:
    from printer_slicer.stream.serial_port import SerialPort

__all__ = ["EXAMPLES", "Talk", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer console /dev/ttyUSB0
  echo M115 | printer-slicer console /dev/ttyUSB0
  printer-slicer console socket://192.168.1.7:8888 --command M503
  printer-slicer console /dev/ttyUSB0 --command M500 --allow eeprom"""
_HELP = "type G-code; Ctrl-D or .quit ends, .temp asks for temperatures, .stop is the emergency stop, .help shows this"
_LOOK = 0.05


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `console`."""
    parser.add_argument("port", metavar="PORT", help="device, or socket:// or rfc2217:// URL")
    parser.add_argument("--baud", type=positive, default=115200, metavar="N", help="default: 115200")
    parser.add_argument(
        "--command", metavar="GCODE", action="append", default=[], help="send this and exit; may be repeated"
    )
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=number,
        default=30.0,
        help="seconds to wait for an answer; default: 30",
    )
    parser.add_argument("--log", metavar="FILE", type=Path, help="append all lines to this file")
    group = parser.add_argument_group(
        "machine", "Commands that could harm this machine are rejected; typing one again sends it."
    )
    add_machine(group)
    add_output(parser)


def run(arguments: argparse.Namespace) -> int:
    """Talk until the input ends."""
    from printer_slicer.cli.jobs import reason_behind
    from printer_slicer.stream.serial_port import open_port

    allow = reason_behind(profile_from(arguments, slices=False, tell=False), arguments.allow)
    log = _log(arguments.log)
    with contextlib.ExitStack() as stack:
        if log:
            stack.callback(log.close)
        port = open_port(arguments.port, arguments.baud)
        stack.callback(port.close)
        talk = Talk(port, timeout=arguments.timeout, log=log, allow=allow)
        if arguments.command:
            for command in arguments.command:
                talk.say(command)
        elif sys.stdin.isatty():
            _converse(talk, quiet=arguments.quiet)
        else:
            for line in sys.stdin:
                if not talk.say(line):
                    break
    return 0


def _log(path: Path | None) -> IO[str] | None:
    """The file that everything is written into.

    Raises:
        OutputError: it cannot be.
    """
    if path is None:
        return None
    try:
        return path.open("a", encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}", remedy="name another file"
        ) from None


def _refuse_nothing(_: bytes) -> str:
    """The policy of a console whose owner has set none."""
    return ""


class Talk:
    """One line after the other, each answered before the next one goes out.

    Args:
        port: open.
        timeout: s of silence after which an answer is not waited for; a printer that says it is busy is not silent.
        log: is given everything that is said.
        allow: a reason why a command is refused, empty if it is not.
    """

    def __init__(
        self,
        port: SerialPort,
        *,
        timeout: float = 30.0,
        log: IO[str] | None = None,
        allow: Callable[[bytes], str] = _refuse_nothing,
    ) -> None:
        self._port = port
        self._timeout = timeout
        self._log = log
        self._allow = allow
        self._partial = b""
        self._refused = b""  # the last line, if it was

    def say(self, line: str, *, asks: bool = False) -> bool:
        """Send a line and show its answer; False when the person wants to end.

        Args:
            line: as typed.
            asks: whether a person is there: what is refused is sent when the same line is typed once more.

        Raises:
            PortError: the printer is gone, or does not answer.
            UsageError: the line can never be sent, or is refused.
        """
        line = line.strip()
        if line in {".quit", ".exit"}:
            return False
        if line == ".help":
            print(_HELP, file=sys.stderr)
            return True
        if line == ".stop":
            self._write(b"\nM112\n")
            return True
        command = self._command(line, asks=asks)
        if command:
            self._write(command + b"\n")
            self._answer(line)
        return True

    def _command(self, line: str, *, asks: bool) -> bytes:
        """The bytes of a line, without comment.

        Raises:
            UsageError: it is refused.
        """
        from printer_slicer.gcode.lexer import strip
        from printer_slicer.stream.framing import check_commands

        command = strip(("M105" if line == ".temp" else line).encode("utf-8", "replace"))
        if line.startswith(".") and line != ".temp":
            raise UsageError(f"{line}: not known", remedy=_HELP)
        check_commands([command])
        insisted, self._refused = bool(command) and self._refused == command, b""
        if command and not insisted and (reason := self._allow(command)):
            self._refused = command if asks else b""
            remedy = "the same line once more sends it" if asks else "if it is meant: --allow NAME"
            raise UsageError(f"{line}: refused: {reason}", remedy=remedy)
        return command

    def _write(self, data: bytes) -> None:
        if self._log:
            self._log.write(f"> {data.decode(errors='replace').strip()}\n")
        self._port.write(data)

    def _answer(self, line: str) -> None:
        """Show what comes until the ok."""
        quiet_since = monotonic()
        while True:
            shown = self.listen(_LOOK)
            if any(one.startswith("ok") for one in shown):
                return
            if any(_is_dead(one) for one in shown):
                raise PortError("the printer has stopped", remedy="reset it")
            if shown:
                quiet_since = monotonic()
            elif monotonic() - quiet_since > self._timeout:
                raise PortError(
                    f"no answer to {line!r} within {self._timeout:g} s",
                    remedy="look at port, speed and power",
                )

    def listen(self, timeout: float) -> list[str]:
        """Show what comes within some time; the lines."""
        *lines, self._partial = (self._partial + self._port.read(timeout)).split(b"\n")
        shown = [line.decode(errors="replace").strip() for line in lines]
        for line in filter(None, shown):
            print(visible(line), flush=True)
            if self._log:
                self._log.write(f"< {line}\n")
        return shown


def _is_dead(line: str) -> bool:
    return "Printer halted" in line or "kill() called" in line


def _converse(talk: Talk, *, quiet: bool) -> None:
    """Show what the printer says by itself, too, while the person types; mistakes do not end it."""
    if not quiet:
        print(_HELP, file=sys.stderr)
    with contextlib.suppress(ImportError):
        import readline  # noqa: F401 - gives `input` its history and editing
    end, typed = os.pipe()
    try:
        while (line := _typed(talk, end, typed)) is not None:
            try:
                if not talk.say(line, asks=True):
                    return
            except UsageError as error:
                print(visible(str(error)), file=sys.stderr)
    except KeyboardInterrupt:
        print(file=sys.stderr)
    finally:
        os.close(end)
        os.close(typed)


def _typed(talk: Talk, end: int, typed: int) -> str | None:
    """A line that the person types; what the printer says meanwhile is shown. None at the end of the input."""
    lines: list[str | None] = []

    def read() -> None:
        """In a thread of its own: waiting for a person must not keep the printer's words."""
        try:
            lines.append(input())
        except (EOFError, OSError):
            lines.append(None)
        os.write(typed, b".")

    Thread(target=read, daemon=True).start()
    while not lines:
        talk.listen(_LOOK)
    select.select([end], [], [])
    os.read(end, 1)
    return lines[0]
