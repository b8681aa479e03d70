"""Options for the port of a printer and for the connection to it."""

from __future__ import annotations

import argparse

from printer_slicer.cli.arguments import parse_timeout
from printer_slicer.cli.help import mark_advanced

__all__ = ["add_connection_options", "add_port_arguments"]


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
