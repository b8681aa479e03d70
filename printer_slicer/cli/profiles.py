"""`profiles` and `ports`."""

from __future__ import annotations

import argparse
import json

from printer_slicer.errors import UsageError

__all__ = ["ports_command", "profiles_command"]


def profiles_command(arguments: argparse.Namespace) -> int:
    """List the shipped profiles, show one, or list all settings."""
    if arguments.what == "settings":
        return _settings(arguments)
    if arguments.what == "list":
        return _list(arguments)
    if not arguments.name:
        raise UsageError(
            f"profiles {arguments.what}: which one?", remedy=f"printer-slicer profiles {arguments.what} NAME"
        )
    return _show(arguments)


def _list(arguments: argparse.Namespace) -> int:
    from printer_slicer.profile import DEFAULT_NAMES, KINDS, profile_paths

    known = {kind: profile_paths(kind) for kind in KINDS}
    if arguments.quiet:
        return 0
    if arguments.json:
        print(
            json.dumps(
                {kind: {name: str(path) for name, path in paths.items()} for kind, paths in known.items()}
            )
        )
        return 0
    for kind, paths in known.items():
        print(f"--{kind}")
        for name, path in paths.items():
            first = path.read_text(encoding="utf-8").splitlines()[0]
            meaning = first.lstrip("# ") if first.startswith("#") else ""
            print(f"  {name + (' (default)' if name == DEFAULT_NAMES[kind] else ''):<26}{meaning}")
    return 0


def _show(arguments: argparse.Namespace) -> int:
    from printer_slicer.profile import part_settings

    chosen = part_settings(arguments.what, arguments.name)
    if arguments.quiet:
        return 0
    if arguments.json:
        print(json.dumps(chosen))
    else:
        for key, value in chosen.items():
            text = f'"""\n{value}"""' if isinstance(value, str) and "\n" in value else value
            print(f"{key} = {text}")
    return 0


def _settings(arguments: argparse.Namespace) -> int:
    from printer_slicer.profile import settings_table

    names = ("key", "type", "unit", "bounds", "default", "meaning")
    if arguments.quiet:
        return 0
    rows = [dict(zip(names, row, strict=True)) for row in settings_table()]
    if arguments.json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        unit = f" {row['unit']}" if row["unit"] else ""
        bounds = f" ({row['bounds']})" if row["bounds"] else ""
        default = "" if "\n" in row["default"] else row["default"]
        print(f"{row['key']:<42}{default}{unit}{bounds}  {row['meaning']}")
    return 0


def ports_command(arguments: argparse.Namespace) -> int:
    """List the serial ports of this computer."""
    from dataclasses import asdict

    from printer_slicer.stream.serial_port import list_ports

    ports = [] if arguments.quiet else list_ports()
    if arguments.json:
        print(json.dumps([asdict(port) for port in ports]))
    elif not ports and not arguments.quiet:
        print("no serial ports found; is the printer switched on and its USB cable plugged in?")
    for port in [] if arguments.json else ports:
        print(f"{port.device:<24}{port.description}")
    return 0
