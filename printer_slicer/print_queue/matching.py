"""Decide on which printers a job can be printed, and say why not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.firmware import FIRMWARES
from printer_slicer.print_queue.file_facts import FileFacts
from printer_slicer.print_queue.printers import PrinterEntry
from printer_slicer.print_queue.records import PrinterState, QueuedJob
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["PrinterTraits", "find_mismatches", "find_obstacles", "is_wanted_printer", "read_traits"]

_TOLERANCE: Final = 0.05  # mm


class PrinterTraits(Struct, frozen=True):
    """What a printer can print.

    Attributes:
        low, high: corners of the space that the nozzle may reach, mm.
        flavour: G-code flavour of the firmware.
        nozzle: diameter of the nozzle, mm.
        material_type: type of the loaded material, such as PLA.
        material: name of the profile of the loaded material.
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    flavour: str
    nozzle: float
    material_type: str
    material: str


def read_traits(entry: PrinterEntry, material: str) -> PrinterTraits:
    """Return what a printer can print with a material.

    Raises:
        UsageError: its profile, or that of the material, does not exist or is invalid.
    """
    from printer_slicer.profile import load_profile  # noqa: PLC0415 - slow

    return _make_traits(load_profile(entry.profile, material, slices=False), material)


def _make_traits(profile: Profile, material: str) -> PrinterTraits:
    """Return what a printer with this profile can print."""
    printer = profile.printer
    (left, front), (right, back) = printer.corners
    return PrinterTraits(
        low=(left - printer.reach, front - printer.reach, 0.0),
        high=(right + printer.reach, back + printer.reach, printer.bed_z),
        flavour=printer.flavour,
        nozzle=printer.nozzle_diameter,
        material_type=profile.material.type or profile.material.name,
        material=material,
    )


def is_wanted_printer(job: QueuedJob, entry: PrinterEntry) -> bool:
    """Return whether a job may be printed on this printer, as far as the user has named one."""
    return job.printer in {"", entry.name, *entry.groups}


def find_mismatches(job: QueuedJob, facts: FileFacts | None, traits: PrinterTraits) -> list[str]:
    """Return why a job cannot be printed on a printer with these traits; empty if it can.

    What the file does not say is no reason.
    """
    if facts is None:
        return ["the file has not been read yet"]
    if facts.problem:
        return [facts.problem]
    reasons = _find_space_mismatches(facts, traits)
    if facts.nozzle is not None and abs(facts.nozzle - traits.nozzle) > _TOLERANCE / 10:
        reasons.append(f"the nozzle is {traits.nozzle:g} mm, {facts.nozzle:g} mm is wanted")
    wanted = job.material or facts.material
    loaded = {traits.material.casefold(), traits.material_type.casefold()}
    if wanted and wanted.casefold() not in loaded:
        reasons.append(f"{traits.material_type} is loaded, {wanted} is wanted")
    if facts.flavour and not _understands(traits.flavour, facts.flavour):
        reasons.append(f"the firmware understands {traits.flavour}, the file is for {facts.flavour}")
    return reasons


def _find_space_mismatches(facts: FileFacts, traits: PrinterTraits) -> list[str]:
    """Return where the extrusions of a file leave the space of a printer."""
    if facts.low is None or facts.high is None:
        return ["the file extrudes nothing"]
    reasons = []
    for axis, letter in enumerate("xyz"):
        low, high = facts.low[axis], facts.high[axis]
        if low < traits.low[axis] - _TOLERANCE or high > traits.high[axis] + _TOLERANCE:
            space = f"{traits.low[axis]:g} to {traits.high[axis]:g} mm"
            reasons.append(
                f"the part extends from {low:g} to {high:g} mm in {letter}, the printer from {space}"
            )
    return reasons


def _understands(printer: str, file: str) -> bool:
    """Return whether a printer of one flavour understands files of another."""
    return file == printer or file in FIRMWARES[printer].also_reads


def find_obstacles(state: PrinterState) -> list[str]:
    """Return why a printer cannot start any job at this moment; empty if it can."""
    if state.job is not None:
        return [f"it is printing job {state.job}"]
    if state.bed != "clear":
        known = "is occupied" if state.bed == "occupied" else "may be occupied"
        return [f"its bed {known}"]
    return []
