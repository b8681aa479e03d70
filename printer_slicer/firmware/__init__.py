"""The firmwares: one file for each, and the one table of them.

Plain Python without arrays or settings, so that the host knows a firmware without knowing the slicer. The simulated
printer does not look here: it judges what these rows say.
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
    "FIRMWARES",
    "FLAVOURS",
    "UNKNOWN_WIRE",
    "WIRE_DIALECTS",
    "Dialect",
    "Firmware",
    "Flavour",
    "WireDialect",
    "flavour_of",
    "wire_dialect_named",
    "wire_dialect_of",
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
"""By the names that `printer.flavour` may have, which are those of `Flavour`."""

FLAVOURS: Final[Mapping[str, Dialect]] = {name: firmware.dialect for name, firmware in FIRMWARES.items()}
"""The G-code of each."""

UNKNOWN_WIRE: Final = "marlin"
"""Who says nothing on the wire is treated like this: every other sequence-checking firmware can live with it."""

# Marlin 2 comes last, because its pattern fits every name.
WIRE_DIALECTS: Final[Mapping[str, WireDialect]] = {
    name: dialect for firmware in [*FIRMWARES.values()][::-1] for name, dialect in firmware.wire.items()
}
"""By the names that a profile or a person may use. The first whose pattern is found in the name that M115 gives."""


def wire_dialect_of(name: str) -> str:
    """Return the name of the wire dialect of a firmware that calls itself so in its answer to M115."""
    return next(key for key, dialect in WIRE_DIALECTS.items() if re.search(dialect.pattern, name))


def wire_dialect_named(name: str) -> WireDialect:
    """Return the wire dialect with this name.

    Raises:
        UsageError: there is none.
    """
    if name not in WIRE_DIALECTS:
        raise UsageError(
            f"no firmware is known by the name {name!r}", remedy=f"known are: {', '.join(WIRE_DIALECTS)}"
        )
    return WIRE_DIALECTS[name]


def flavour_of(dialect: WireDialect) -> str:
    """Return the flavour of G-code that a firmware with this wire dialect reads."""
    return next(name for name, firmware in FIRMWARES.items() if dialect in firmware.wire.values())
