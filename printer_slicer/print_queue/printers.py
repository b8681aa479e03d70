"""The printers that the queue prints on, from the file `printers.toml`.

Each table of the file is a printer. Its key `port` names a serial device, a pyserial URL, `sim:` for a simulated
printer, or a print server such as `octoprint:http://octopi.local`; `profile` names its printer profile.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.input_files import read_input
from printer_slicer.texts import describe_type
from printer_slicer.toml_text import MAX_BYTES, TomlError, parse_toml
from printer_slicer.values import Struct

__all__ = [
    "SERVER_KINDS",
    "SIMULATED",
    "PrinterEntry",
    "find_printers_file",
    "list_missing_profiles",
    "parse_printers",
    "read_printers",
]

SIMULATED: Final = "sim:"
"""The port that stands for a simulated printer."""

SERVER_KINDS: Final = ("octoprint", "moonraker", "prusalink", "duet")
"""Kinds of print servers, as in `sending.SERVERS`, whose module is slow to import."""

_NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,40}")
_WEBCAM: Final = re.compile(r"https?://[A-Za-z0-9.-]+(:\d{1,5})?(/[!-~]*)?")
_SERVER_ADDRESS: Final = re.compile(r"https?://[^\s/]+(/\S*)?")
_SERVER_EXAMPLE: Final = '"octoprint:http://octopi.local"'
_EXAMPLE: Final = 'a table [left] with port = "/dev/ttyUSB0" and profile = "prusa_mk4"'
_ADD: Final = "Add one: printer-slicer queue add-printer left /dev/ttyUSB0 prusa_mk4"


class PrinterEntry(Struct, frozen=True, kw_only=True):
    """A printer in printers.toml.

    Attributes:
        name: name of its table.
        port: serial device, pyserial URL, `sim:` for a simulated printer, or `KIND:URL` for a print server.
        profile: name of the printer profile.
        material: name of the material profile that is loaded, unless a person has named another one since.
        groups: names that jobs may use instead of its own name.
        baud: baud rate; 0: that of the profile.
        reconnect: time to wait for a printer that was disconnected, s.
        guard: time after which a second process switches the heaters off if the print process has died, s.
        key_file: of a print server, file with its API key or password; empty: none.
        user: of a print server, user name that belongs to the password.
        webcam: address of a picture or MJPEG stream that browsers load; empty: none.
        webcam_interval: time between two pictures, s; 0: the address is a stream.
        speed: of a simulated printer, simulated seconds per second; 0: as fast as possible.
    """

    name: str
    port: str
    profile: str
    material: str = "pla"
    groups: tuple[str, ...] = ()
    baud: int = 0
    reconnect: float = 30.0
    guard: float = 120.0
    key_file: str = ""
    user: str = ""
    webcam: str = ""
    webcam_interval: float = 0.0
    speed: float = 1.0

    @property
    def is_simulated(self) -> bool:
        """Whether the printer is simulated."""
        return self.port == SIMULATED

    @property
    def server(self) -> tuple[str, str] | None:
        """Kind and address of the print server; None for a port."""
        kind, _, url = self.port.partition(":")
        return (kind, url) if kind in SERVER_KINDS else None


_TYPES: Final[Mapping[str, type]] = {
    "port": str,
    "profile": str,
    "material": str,
    "groups": list,
    "baud": int,
    "reconnect": float,
    "guard": float,
    "key_file": str,
    "user": str,
    "webcam": str,
    "webcam_interval": float,
    "speed": float,
}
_REQUIRED: Final = ("port", "profile")


def find_printers_file() -> Path:
    """Return the path of printers.toml: $PRINTER_SLICER_PRINTERS, or a file in the user's configuration folder."""
    if named := os.environ.get("PRINTER_SLICER_PRINTERS"):
        return Path(named)
    from platformdirs import user_config_path  # noqa: PLC0415 - slow, and only needed here

    return Path(user_config_path("printer_slicer", appauthor=False)) / "printers.toml"


def read_printers(path: Path) -> tuple[PrinterEntry, ...]:
    """Read the printers in a file, in its order.

    Raises:
        UsageError: the file is missing, or an entry is invalid; names file, printer and key.
    """
    try:
        text = read_input(path, MAX_BYTES).decode("utf-8")
    except FileNotFoundError:
        raise UsageError(
            f"{path}: there is no such file, so the queue has no printers",
            remedy=_ADD,
        ) from None
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read: {error}", remedy="Check the file") from None
    try:
        return parse_printers(parse_toml(text))
    except TomlError as error:
        raise UsageError(f"{path}: {error}", remedy="Correct this line") from None
    except UsageError as error:
        raise UsageError(f"{path}: {error.args[0]}", remedy=error.remedy) from None


def list_missing_profiles(entries: Iterable[PrinterEntry]) -> tuple[str, ...]:
    """Return a sentence for each printer whose profile does not exist."""
    from printer_slicer.profile.folders import find_profile_paths  # noqa: PLC0415 - slow

    known = find_profile_paths("printer")
    return tuple(
        f"{one.name}: there is no printer profile {one.profile}, so nothing is printed there"
        for one in entries
        if one.profile not in known and not Path(one.profile).expanduser().is_file()
    )


def parse_printers(tables: Mapping[str, Any]) -> tuple[PrinterEntry, ...]:
    """Make printers from the tables of a file: name -> keys.

    Raises:
        UsageError: an entry is invalid, or there is none.
    """
    if not tables:
        raise UsageError("there are no printers", remedy=_ADD)
    entries = tuple(_parse_entry(name, table) for name, table in tables.items())
    names = {entry.name for entry in entries}
    ports: dict[str, str] = {}
    for entry in entries:
        if shared := names & set(entry.groups):
            raise UsageError(
                f"{entry.name}: the group {min(shared)} has the name of a printer", remedy="Rename the group"
            )
        if not entry.is_simulated and ports.setdefault(entry.port, entry.name) != entry.name:
            raise UsageError(
                f"{ports[entry.port]} and {entry.name} have the same port {entry.port}",
                remedy="Name another port, such as one in /dev/serial/by-id",
            )
    return entries


def _parse_entry(name: str, table: object) -> PrinterEntry:
    """Make a printer from its table.

    Raises:
        UsageError: a key is missing, unknown, or of the wrong type.
    """
    if not _NAME.fullmatch(name):
        raise UsageError(
            f"{name!r} is not a valid name of a printer",
            remedy="Use up to 40 letters, digits, hyphens and underscores",
        )
    if not isinstance(table, Mapping):
        raise UsageError(f"{name}: is not a table", remedy=f"Write a table per printer: {_EXAMPLE}")
    if unknown := [key for key in table if key not in _TYPES]:
        raise UsageError(f"{name}: unknown key {unknown[0]}", remedy=f"Known keys: {', '.join(_TYPES)}")
    if missing := [key for key in _REQUIRED if not table.get(key)]:
        raise UsageError(f"{name}: {missing[0]} is missing", remedy=f"Add it, as in: {_EXAMPLE}")
    values = {key: _convert(name, key, value) for key, value in table.items()}
    if values["port"] != SIMULATED and "speed" in values:
        raise UsageError(
            f"{name}: speed is for simulated printers only",
            remedy=f'Remove it, or set port = "{SIMULATED}"',
        )
    if values.get("webcam") and not _WEBCAM.fullmatch(values["webcam"]):
        raise UsageError(
            f"{name}: webcam is not an address of a picture or stream",
            remedy='Set it to an address such as "http://octopi.local/webcam/?action=stream"',
        )
    entry = PrinterEntry(name=name, **values)
    if entry.server is not None and not _SERVER_ADDRESS.fullmatch(entry.server[1]):
        raise UsageError(
            f"{name}: {entry.port} is not the address of a print server",
            remedy=f"Write it as in port = {_SERVER_EXAMPLE}",
        )
    if entry.server is None and (given := [key for key in ("key_file", "user") if key in values]):
        raise UsageError(
            f"{name}: {given[0]} is for print servers only",
            remedy=f"Remove it, or set port to {_SERVER_EXAMPLE}",
        )
    return entry


def _convert(name: str, key: str, value: object) -> Any:
    """Check the type and the bounds of a value, and convert lists to tuples.

    Raises:
        UsageError: the value is invalid.
    """
    wanted = _TYPES[key]
    if wanted is float and type(value) is int:
        value = float(value)
    is_valid = type(value) is wanted
    if isinstance(value, list):
        is_valid = wanted is list and all(isinstance(item, str) for item in value)
        value = tuple(value)
    if isinstance(value, float | int):
        is_valid = is_valid and 0 <= value < float("inf")
    if not is_valid:
        expected = {
            list: "a list of names",
            float: "a number from 0",
            int: "a whole number from 0",
            str: "a text",
        }
        raise UsageError(
            f"{name}: {key} is {describe_type(value)}, or out of range",
            remedy=f"Set it to {expected[wanted]}",
        )
    return value
