"""`console`: send G-code to a printer interactively or from a pipe."""

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
from printer_slicer.cli.output import sanitize
from printer_slicer.cli.settings import profile_from
from printer_slicer.errors import OutputError, PortError, UsageError

if TYPE_CHECKING:
    from printer_slicer.stream.serial_port import SerialPort

__all__ = ["EXAMPLES", "Console", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer console /dev/ttyUSB0
  echo M115 | printer-slicer console /dev/ttyUSB0
  printer-slicer console socket://192.168.1.7:8888 --command M503
  printer-slicer console /dev/ttyUSB0 --command M500 --allow eeprom"""
_HELP = "type G-code; .temp reads temperatures, .stop is an emergency stop, .help shows this, .quit or Ctrl-D exits"
_LOOK = 0.05  # s between reads of the port


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
    """Send commands until the input ends."""
    from printer_slicer.cli.jobs import console_check
    from printer_slicer.stream.serial_port import open_port

    allow = console_check(profile_from(arguments, slices=False, tell=False), arguments.allow)
    log = _log(arguments.log)
    with contextlib.ExitStack() as stack:
        if log:
            stack.callback(log.close)
        port = open_port(arguments.port, arguments.baud)
        stack.callback(port.close)
        console = Console(port, timeout=arguments.timeout, log=log, allow=allow)
        if arguments.command:
            for command in arguments.command:
                console.say(command)
        elif sys.stdin.isatty():
            _converse(console, quiet=arguments.quiet)
        else:
            for line in sys.stdin:
                if not console.say(line):
                    break
    return 0


def _log(path: Path | None) -> IO[str] | None:
    """Open the log file; None without one.

    Raises:
        OutputError: it cannot be written.
    """
    if path is None:
        return None
    try:
        return path.open("a", encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}", remedy="Choose another file"
        ) from None


def _accept_everything(_: bytes) -> str:
    """Accept every command."""
    return ""


class Console:
    """A conversation with a printer: sends one line at a time and waits for its acknowledgement.

    Args:
        port: open.
        timeout: s without any reply after which an error is raised; "busy" replies count as replies.
        log: receives all lines sent and received.
        allow: returns why a command is refused; empty if it is not.
    """

    def __init__(
        self,
        port: SerialPort,
        *,
        timeout: float = 30.0,
        log: IO[str] | None = None,
        allow: Callable[[bytes], str] = _accept_everything,
    ) -> None:
        self._port = port
        self._timeout = timeout
        self._log = log
        self._allow = allow
        self._partial = b""
        self._refused = b""  # the last line if it was refused

    def say(self, line: str, *, asks: bool = False) -> bool:
        """Send a line and print the reply; return False to exit.

        Args:
            line: as typed.
            asks: whether it is interactive: a refused line is sent if it is typed once more.

        Raises:
            PortError: the printer is gone, or does not reply.
            UsageError: the line is invalid or refused.
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
        """Return the bytes of a line without its comment.

        Raises:
            UsageError: the command is refused.
        """
        from printer_slicer.gcode.lexer import strip
        from printer_slicer.stream.framing import check_commands

        command = strip(("M105" if line == ".temp" else line).encode("utf-8", "replace"))
        if line.startswith(".") and line != ".temp":
            raise UsageError(f"{line}: unknown console command", remedy=_HELP)
        check_commands([command])
        insisted, self._refused = bool(command) and self._refused == command, b""
        if command and not insisted and (reason := self._allow(command)):
            self._refused = command if asks else b""
            remedy = "Type the same line again to send it" if asks else "Use --allow NAME to send it anyway"
            raise UsageError(f"{line}: refused: {reason}", remedy=remedy)
        return command

    def _write(self, data: bytes) -> None:
        if self._log:
            self._log.write(f"> {data.decode(errors='replace').strip()}\n")
        self._port.write(data)

    def _answer(self, line: str) -> None:
        """Print replies until the acknowledgement."""
        quiet_since = monotonic()
        while True:
            shown = self.listen(_LOOK)
            if any(one.startswith("ok") for one in shown):
                return
            if any(_is_dead(one) for one in shown):
                raise PortError("the printer has halted", remedy="Reset the printer")
            if shown:
                quiet_since = monotonic()
            elif monotonic() - quiet_since > self._timeout:
                raise PortError(
                    f"no reply to {line!r} within {self._timeout:g} s",
                    remedy="Check the port, the baud rate and the power of the printer",
                )

    def listen(self, timeout: float) -> list[str]:
        """Print the lines that arrive within a timeout, and return them."""
        *lines, self._partial = (self._partial + self._port.read(timeout)).split(b"\n")
        shown = [line.decode(errors="replace").strip() for line in lines]
        for line in filter(None, shown):
            print(sanitize(line), flush=True)
            if self._log:
                self._log.write(f"< {line}\n")
        return shown


def _is_dead(line: str) -> bool:
    return "Printer halted" in line or "kill() called" in line


def _converse(console: Console, *, quiet: bool) -> None:
    """Read commands from the terminal, and print what the printer sends meanwhile; errors do not end it."""
    if not quiet:
        print(_HELP, file=sys.stderr)
    with contextlib.suppress(ImportError):
        import readline  # noqa: F401 - gives `input` its history and editing
    end, typed = os.pipe()
    try:
        while (line := _typed(console, end, typed)) is not None:
            try:
                if not console.say(line, asks=True):
                    return
            except UsageError as error:
                print(sanitize(str(error)), file=sys.stderr)
    except KeyboardInterrupt:
        print(file=sys.stderr)
    finally:
        os.close(end)
        os.close(typed)


def _typed(console: Console, end: int, typed: int) -> str | None:
    """Return the next typed line and print what the printer sends meanwhile; None at the end of the input."""
    lines: list[str | None] = []

    def read() -> None:
        """Read a line; this runs in a thread, because it blocks."""
        try:
            lines.append(input())
        except (EOFError, OSError):
            lines.append(None)
        os.write(typed, b".")

    Thread(target=read, daemon=True).start()
    while not lines:
        console.listen(_LOOK)
    select.select([end], [], [])
    os.read(end, 1)
    return lines[0]
