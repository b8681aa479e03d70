"""Add a printer to printers.toml, after the name of its firmware was compared with its profile."""

from __future__ import annotations

import json
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import PortError, UsageError
from printer_slicer.firmware import FIRMWARES, match_flavour
from printer_slicer.input_files import read_input
from printer_slicer.print_queue.printers import PrinterEntry, parse_printers
from printer_slicer.saving import make_folder, save
from printer_slicer.toml_text import MAX_BYTES, TomlError, parse_toml

if TYPE_CHECKING:
    from printer_slicer.stream.events import Event

__all__ = ["add_printer"]

_CONNECT_TIMEOUT: Final = 10.0  # s
_KEYS: Final = ("port", "profile", "material")


def add_printer(path: Path, entry: PrinterEntry, *, check: bool = True) -> str:
    """Append a printer to a file, which is created with its folder if it is missing.

    Args:
        path: the file printers.toml.
        entry: the printer; of its keys, port, profile and material are written.
        check: whether to ask the firmware of a printer at a serial port for its name (M115), and to compare it.

    Returns:
        Name of the firmware; empty if it was not asked.

    Raises:
        UsageError: the file is or would become invalid, a profile is missing, or the firmware does not fit the profile.
        PortError: the port cannot be opened, or nothing answers.
        OutputError: the file cannot be written.
    """
    from printer_slicer.profile import load_profile  # noqa: PLC0415 - slow

    before = _read_text(path)
    tables = parse_toml(before)
    if entry.name in tables:
        raise UsageError(f"{path}: there is already a printer {entry.name}", remedy="Choose another name")
    values = {key: getattr(entry, key) for key in _KEYS}
    parse_printers({**tables, entry.name: values})
    printer = load_profile(entry.profile, entry.material, slices=False).printer
    firmware = ""
    if check and not entry.is_simulated and entry.server is None:
        firmware = _read_firmware_name(entry.port, printer.baud)
        _check_firmware(firmware, printer.flavour, entry)
    lines = [f"[{entry.name}]", *(f"{key} = {json.dumps(value)}" for key, value in values.items()), ""]
    make_folder(path.parent)
    save(path, ((f"{before.rstrip()}\n\n" if before.strip() else "") + "\n".join(lines)).encode())
    return firmware


def _read_text(path: Path) -> str:
    """Return the text of a file with valid TOML; empty if it is missing.

    Raises:
        UsageError: it cannot be read.
    """
    try:
        text = read_input(path, MAX_BYTES).decode("utf-8") if path.exists() else ""
        parse_toml(text)
    except (OSError, ValueError, TomlError) as error:
        raise UsageError(f"{path}: cannot be read: {error}", remedy="Correct the file") from None
    return text


def _read_firmware_name(port: str, baud: int) -> str:
    """Return the name of the firmware that a printer reports to M115; empty if it reports none.

    Raises:
        PortError: the port cannot be opened, or nothing answers.
    """
    from printer_slicer.stream.events import Halted, Identified  # noqa: PLC0415 - slow
    from printer_slicer.stream.protocol import Streamer  # noqa: PLC0415 - slow
    from printer_slicer.stream.serial_port import open_port  # noqa: PLC0415 - slow
    from printer_slicer.stream.session import run  # noqa: PLC0415 - slow

    names, reasons = [""], list[str]()

    def listen(event: Event) -> None:
        """Store the name of the firmware, or why there is none."""
        if isinstance(event, Identified):
            names.append(event.firmware)
        elif isinstance(event, Halted):
            reasons.append(event.reason)

    transport = open_port(port, baud)
    try:
        run(Streamer([], connect_timeout=_CONNECT_TIMEOUT), transport, monotonic, on_event=listen)
    finally:
        transport.close()
    if reasons:
        raise PortError(f"{port}: {reasons[0]}", remedy=f"Run printer-slicer doctor {port}")
    return names[-1]


def _check_firmware(name: str, wanted: str, entry: PrinterEntry) -> None:
    """Check that a firmware understands G-code of a flavour.

    Raises:
        UsageError: it does not, or it has no name.
    """
    if not name:
        raise UsageError(
            f"{entry.port}: the printer does not name its firmware",
            remedy="If the profile is right, add --no-check",
        )
    flavour = match_flavour(name)
    if wanted != flavour and wanted not in FIRMWARES[flavour].also_reads:
        raise UsageError(
            f"{entry.port}: the firmware is {name}, and the profile {entry.profile} is for {wanted}",
            remedy="Choose another profile, or add --no-check if this one is right",
        )
