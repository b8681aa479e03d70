"""Options for the port of a printer and for the connection to it."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Final

from printer_slicer.cli.arguments import parse_timeout
from printer_slicer.cli.help import mark_advanced
from printer_slicer.errors import PortError, UsageError

__all__ = [
    "SIMULATED_PORT",
    "add_connection_options",
    "add_port_arguments",
    "occupy_queue_bed",
    "read_server_key",
    "reject_simulated_port",
]

_KEY_VARIABLE: Final = "PRINTER_SLICER_KEY"
SIMULATED_PORT: Final = "sim:"
"""The port of `print` that stands for the simulated printer."""


def read_server_key(key_file: Path | None, key: str | None = None) -> str:
    """Return the API key or password of a server: from a file, as given, or from the environment.

    Raises:
        UsageError: the key file cannot be read.
    """
    if key_file is None:
        return key or os.environ.get(_KEY_VARIABLE, "")
    try:
        text = key_file.expanduser().read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(
            f"{key_file}: cannot be read: {reason}",
            remedy="Name a file that contains the key in its first line",
        ) from None
    return next(iter(text.split()), "")


def reject_simulated_port(port: str) -> None:
    """Reject the name of the simulated printer as a port.

    Raises:
        PortError: the port is `sim:`, or `sim` without a file of this name.
    """
    if port == SIMULATED_PORT:
        raise PortError(
            "sim: is a port of print only",
            remedy="Start a simulated printer with printer-slicer sim --pty /tmp/printer, and use its port "
            "/tmp/printer",
        )
    if f"{port}:" == SIMULATED_PORT and not Path(port).exists():
        raise PortError(
            f"there is no port {port}", remedy="Did you mean sim:, the simulated printer of print?"
        )


def occupy_queue_bed(port: str) -> None:
    """Tell the queue, if there is one, that a print begins on a port, so that no job is started onto its part."""
    from printer_slicer.print_queue.folders import has_default_queue

    if has_default_queue():
        from printer_slicer.print_queue.queue_store import occupy_bed_on_port

        occupy_bed_on_port(port)


def add_port_arguments(parser: argparse.ArgumentParser, meaning: str, *, required: bool) -> None:
    """Add the argument PORT to a command, and --port for those who know the option from `print`.

    Args:
        parser: parser of the command.
        meaning: help of the argument.
        required: whether a port must be named.
    """
    group = parser.add_mutually_exclusive_group(required=required)
    group.add_argument("port", nargs="?", metavar="PORT", default=argparse.SUPPRESS, help=meaning)
    mark_advanced(group.add_argument("--port", metavar="PORT", help="the same as the argument PORT"))


def add_connection_options(parser: argparse.ArgumentParser) -> None:
    """Add the options for the connection to a printer, and for what happens when it is lost."""
    group = parser.add_argument_group("connection")
    mark_advanced(
        group.add_argument(
            "--dtr",
            choices=("auto", "on", "off"),
            default="auto",
            help="state of the DTR line, which resets many boards when the port is opened; auto leaves it to the "
            "system; default: auto",
        )
    )
    mark_advanced(
        group.add_argument(
            "--reconnect",
            metavar="S",
            type=parse_timeout,
            default=30.0,
            help="seconds to wait for the printer to come back after its cable was unplugged; default: 30",
        )
    )
    mark_advanced(
        group.add_argument(
            "--guard",
            metavar="S",
            type=parse_timeout,
            default=120.0,
            help="seconds after which a second process switches the heaters off if this program has crashed and the "
            "print was not resumed; 0: never; default: 120",
        )
    )
    mark_advanced(
        group.add_argument(
            "--ready-file",
            metavar="FILE",
            type=Path,
            help="write the process id and the folder of the print to FILE, as JSON, when the print can be controlled",
        )
    )
