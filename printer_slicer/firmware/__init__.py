"""The supported firmwares, one module each.

This package does not load numpy or the settings, so the host can import it without the slicer. The simulated printer
has tables of its own, so that tests can compare the two.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, Literal, TypeAlias

from printer_slicer.errors import UsageError
from printer_slicer.firmware.firmware import Dialect, Firmware, WireDialect
from printer_slicer.firmware.klipper import KLIPPER
from printer_slicer.firmware.marlin import MARLIN
from printer_slicer.firmware.marlin_legacy import MARLIN_LEGACY
from printer_slicer.firmware.prusa import PRUSA
from printer_slicer.firmware.repetier import REPETIER
from printer_slicer.firmware.reprapfirmware import REPRAPFIRMWARE
from printer_slicer.firmware.smoothie import SMOOTHIE

__all__ = [
    "DEFAULT_WIRE_DIALECT",
    "FIRMWARES",
    "FLAVOURS",
    "WIRE_DIALECTS",
    "Dialect",
    "Firmware",
    "Flavour",
    "WireDialect",
    "get_flavour",
    "get_wire_dialect",
    "match_flavour",
    "match_wire_dialect",
]

Flavour: TypeAlias = Literal[
    "marlin", "marlin_legacy", "klipper", "reprapfirmware", "repetier", "smoothie", "prusa"
]

FIRMWARES: Final[Mapping[str, Firmware]] = {
    "marlin": MARLIN,
    "marlin_legacy": MARLIN_LEGACY,
    "klipper": KLIPPER,
    "reprapfirmware": REPRAPFIRMWARE,
    "repetier": REPETIER,
    "smoothie": SMOOTHIE,
    "prusa": PRUSA,
}
"""Firmwares by flavour, as in `printer.flavour`."""

FLAVOURS: Final[Mapping[str, Dialect]] = {name: firmware.dialect for name, firmware in FIRMWARES.items()}
"""G-code dialects by flavour."""

DEFAULT_WIRE_DIALECT: Final = "marlin"
"""Wire dialect of a printer that does not name its firmware; safe for every firmware that checks line numbers."""

# Marlin 2 comes last, because its pattern fits every name.
WIRE_DIALECTS: Final[Mapping[str, WireDialect]] = {
    name: dialect for firmware in [*FIRMWARES.values()][::-1] for name, dialect in firmware.wire.items()
}
"""Wire dialects by name, as in `Streamer(dialect=...)`; the first whose pattern matches the reply to M115 applies."""


def match_wire_dialect(m115_name: str) -> str:
    """Return the name of the wire dialect whose pattern matches the firmware name in a reply to M115."""
    return next(name for name, dialect in WIRE_DIALECTS.items() if re.search(dialect.m115_pattern, m115_name))


def match_flavour(m115_name: str) -> str:
    """Return the G-code flavour of the firmware with this name in a reply to M115; `marlin` if it is not known.

    Prusa's Buddy firmware has the wire dialect of Marlin and the G-code of Prusa's other firmware.
    """
    if "Prusa-Firmware" in m115_name:
        return "prusa"
    dialect = match_wire_dialect(m115_name)
    return next(flavour for flavour, firmware in FIRMWARES.items() if dialect in firmware.wire)


def get_wire_dialect(name: str) -> WireDialect:
    """Return the wire dialect with this name.

    Raises:
        UsageError: there is no such dialect.
    """
    if name not in WIRE_DIALECTS:
        raise UsageError(
            f"unknown wire dialect {name!r}", remedy=f"Choose one of: {', '.join(WIRE_DIALECTS)}"
        )
    return WIRE_DIALECTS[name]


def get_flavour(dialect: WireDialect) -> str:
    """Return the flavour of G-code that a firmware with this wire dialect reads."""
    return next(name for name, firmware in FIRMWARES.items() if dialect in firmware.wire.values())
