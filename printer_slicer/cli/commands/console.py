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

from printer_slicer.cli.arguments import (
    add_machine_options,
    add_output_options,
    parse_number,
    parse_positive_integer,
)
from printer_slicer.cli.connection_options import add_port_arguments, reject_simulated_port
from printer_slicer.cli.output import sanitize
from printer_slicer.cli.settings import load_selected_profile
from printer_slicer.errors import OutputError, PortError, UsageError

if TYPE_CHECKING:
    from printer_slicer.stream.serial_port import SerialPort

__all__ = ["EXAMPLES", "Console", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer console /dev/ttyUSB0
  echo M115 | printer-slicer console /dev/ttyUSB0
  printer-slicer console socket://192.168.1.7:8888 --command M503
  printer-slicer console /dev/ttyUSB0 --command M500 --allow eeprom"""
_HELP = (
    "type G-code; .temp reads temperatures, .abort is an emergency stop, .help shows this help, "
    ".quit or Ctrl-D exits"
)
_POLL_SECONDS = 0.05  # s between reads of the port


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `console`."""
    add_port_arguments(parser, "serial device, or socket:// or rfc2217:// URL", required=True)
    parser.add_argument(
        "--baud", type=parse_positive_integer, default=115200, metavar="N", help="baud rate; default: 115200"
    )
    parser.add_argument(
        "--command",
        metavar="GCODE",
        action="append",
        default=[],
        help="send this command and exit; may be repeated",
    )
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=parse_number,
        default=30.0,
        help="seconds to wait for a reply of the printer; default: 30",
    )
    parser.add_argument(
        "--log", metavar="FILE", type=Path, help="append all lines that are sent and received to this file"
    )
    group = parser.add_argument_group(
        "machine", "Commands that could harm this machine are rejected; to send one anyway, type it again."
    )
    add_machine_options(group)
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Send commands until the input ends."""
    from printer_slicer.inspection.lint.typed_commands import make_console_check
    from printer_slicer.stream.serial_port import open_port

    reject_simulated_port(arguments.port)
    allow = make_console_check(load_selected_profile(arguments, slices=False, tell=False), arguments.allow)
    log = _open_log(arguments.log)
    with contextlib.ExitStack() as stack:
        if log:
            stack.callback(log.close)
        port = open_port(arguments.port, arguments.baud)
        stack.callback(port.close)
        console = Console(port, timeout=arguments.timeout, log=log, allow=allow)
        if arguments.command:
            for command in arguments.command:
                console.send_line(command)
        elif sys.stdin.isatty():
            _run_interactively(console, quiet=arguments.quiet)
        else:
            for line in sys.stdin:
                if not console.send_line(line):
                    break
    return 0


def _open_log(path: Path | None) -> IO[str] | None:
    """Open the log file; return None if no file is named.

    Raises:
        OutputError: the file cannot be written.
    """
    if path is None:
        return None
    try:
        return path.open("a", encoding="utf-8")
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}", remedy="Choose another file with --log"
        ) from None


def _accept_everything(_: bytes) -> str:
    """Accept every command: return no reason to reject it."""
    return ""


class Console:
    """Sends lines to a printer, one at a time, and waits for the acknowledgement of each.

    Args:
        port: the open port.
        timeout: time without any reply, s, after which an error is raised; "busy" replies count as replies.
        log: file for all lines sent and received.
        allow: function that returns why a command is rejected; empty if it is accepted.
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
        self._refused = b""  # the last command, if it was rejected

    def send_line(self, line: str, *, is_interactive: bool = False) -> bool:
        """Send a line and print the reply; return False if the line ends the console.

        Args:
            line: the line as typed.
            is_interactive: whether a user types the lines: a rejected line is sent if it is typed once more.

        Raises:
            PortError: the printer was disconnected, or does not reply.
            UsageError: the line is invalid or rejected.
        """
        line = line.strip()
        if line in {".quit", ".exit"}:
            return False
        if line == ".help":
            print(_HELP, file=sys.stderr)
            return True
        if line in {".abort", ".stop"}:
            self._write(b"\nM112\n")
            return True
        command = self._parse_line(line, is_interactive=is_interactive)
        if command:
            self._write(command + b"\n")
            self._wait_for_acknowledgement(line)
        return True

    def _parse_line(self, line: str, *, is_interactive: bool) -> bytes:
        """Return the G-code command of a line, without its comment, after checking it.

        Raises:
            UsageError: the command is rejected.
        """
        from printer_slicer.gcode.lexer import strip
        from printer_slicer.stream.framing import check_commands

        command = strip(("M105" if line == ".temp" else line).encode("utf-8", "replace"))
        if line.startswith(".") and line != ".temp":
            raise UsageError(f"{line}: unknown console command", remedy=_HELP)
        check_commands([command])
        is_repeated, self._refused = bool(command) and self._refused == command, b""
        if command and not is_repeated and (reason := self._allow(command)):
            self._refused = command if is_interactive else b""
            remedy = (
                "Type the same line again to send it"
                if is_interactive
                else "Use --allow NAME to send it anyway"
            )
            raise UsageError(f"{line}: rejected: {reason}", remedy=remedy)
        return command

    def _write(self, data: bytes) -> None:
        """Write data to the port and to the log."""
        if self._log:
            self._log.write(f"> {data.decode(errors='replace').strip()}\n")
        self._port.write(data)

    def _wait_for_acknowledgement(self, line: str) -> None:
        """Print replies of the printer until it acknowledges the line.

        Raises:
            PortError: the printer has halted, or does not reply in time.
        """
        quiet_since = monotonic()
        while True:
            shown = self.print_received(_POLL_SECONDS)
            if any(one.startswith("ok") for one in shown):
                return
            if any(_is_halt_message(one) for one in shown):
                raise PortError("the printer has halted and accepts no commands", remedy="Reset the printer")
            if shown:
                quiet_since = monotonic()
            elif monotonic() - quiet_since > self._timeout:
                raise PortError(
                    f"no reply to {line!r} within {self._timeout:g} s",
                    remedy="Check the port, the baud rate and the power of the printer",
                )

    def print_received(self, timeout: float) -> list[str]:
        """Print the lines that arrive from the printer within a timeout, s, and return them."""
        *lines, self._partial = (self._partial + self._port.read(timeout)).split(b"\n")
        shown = [line.decode(errors="replace").strip() for line in lines]
        for line in filter(None, shown):
            print(sanitize(line), flush=True)
            if self._log:
                self._log.write(f"< {line}\n")
        return shown


def _is_halt_message(line: str) -> bool:
    """Return whether a line of the printer says that it has halted."""
    return "Printer halted" in line or "kill() called" in line


def _run_interactively(console: Console, *, quiet: bool) -> None:
    """Send commands typed on the terminal, and print all lines of the printer; usage errors do not end the console."""
    if not quiet:
        print(_HELP, file=sys.stderr)
    with contextlib.suppress(ImportError):
        import readline  # noqa: F401 - gives `input` its history and editing
    read_end, write_end = os.pipe()
    try:
        while (line := _wait_for_typed_line(console, read_end, write_end)) is not None:
            try:
                if not console.send_line(line, is_interactive=True):
                    return
            except UsageError as error:
                print(sanitize(str(error)), file=sys.stderr)
    except KeyboardInterrupt:
        print(file=sys.stderr)
    finally:
        os.close(read_end)
        os.close(write_end)


def _wait_for_typed_line(console: Console, read_end: int, write_end: int) -> str | None:
    """Wait for the next typed line, printing lines of the printer meanwhile; return None at the end of the input."""
    lines: list[str | None] = []

    def read_typed_line() -> None:
        """Read a line of input; this runs in a thread, because it blocks."""
        try:
            lines.append(input())
        except (EOFError, OSError):
            lines.append(None)
        os.write(write_end, b".")

    Thread(target=read_typed_line, daemon=True).start()
    while not lines:
        console.print_received(_POLL_SECONDS)
    select.select([read_end], [], [])
    os.read(read_end, 1)
    return lines[0]
