"""Read from a G-code file what decides on which printers it can be printed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.input_files import read_input
from printer_slicer.values import Struct, as_dict

if TYPE_CHECKING:
    from printer_slicer.gcode import Moves

__all__ = ["FileFacts", "format_facts", "parse_facts", "read_file_facts"]

_MAX_BYTES: Final = 1 << 30


class FileFacts(Struct, frozen=True):
    """What a G-code file says about itself. What it does not say is None or empty.

    Attributes:
        seconds: modelled time of the moves, s, without homing and heating.
        layers: number of layers.
        filament: length of filament, mm.
        low, high: corners of the box that contains all extrusions, mm.
        printer: display name of the printer profile in the file.
        flavour: G-code flavour in the file.
        nozzle: diameter of the nozzle in the file, mm.
        material: type of the material in the file, such as PLA.
        problem: why the file cannot be printed at all; empty if it can.
    """

    seconds: float = 0.0
    layers: int = 0
    filament: float = 0.0
    low: tuple[float, float, float] | None = None
    high: tuple[float, float, float] | None = None
    printer: str = ""
    flavour: str = ""
    nozzle: float | None = None
    material: str = ""
    problem: str = ""


def read_file_facts(path: Path, name: str) -> FileFacts:
    """Read a G-code file; takes about as long as checking it.

    Args:
        path: the file.
        name: name of the file for messages.

    Raises:
        PrinterSlicerError: the file cannot be read. A file without commands has a `problem` instead.
    """
    from printer_slicer.gcode import read_moves_in_pieces  # noqa: PLC0415 - slow
    from printer_slicer.importing.gcode_files import read_gcode_settings  # noqa: PLC0415 - slow
    from printer_slicer.jobs import JobSummary, split_sendable  # noqa: PLC0415 - slow
    from printer_slicer.motion.rules import limits_of  # noqa: PLC0415 - slow
    from printer_slicer.profile import complete_profile  # noqa: PLC0415 - slow

    own = dict(read_gcode_settings(path).values)
    try:
        profile = complete_profile(own, {})
    except ProfileError:
        own, profile = {}, complete_profile({}, {})
    printer = profile.printer
    try:
        split = split_sendable(name, read_input(path, _MAX_BYTES))
    except UsageError as error:
        return FileFacts(problem=str(error.args[0]))
    summary, box = JobSummary(limits_of(printer)), _ExtrusionBox()
    for piece in read_moves_in_pieces(split.commands, printer.corners[0], FLAVOURS[printer.flavour]):
        box.add(summary.add(piece))
    job = summary.make_job(name, b"", split)
    return FileFacts(
        seconds=round(job.seconds, 1),
        layers=job.last_layer or len(job.heights),
        filament=round(box.filament, 1),
        low=box.low,
        high=box.high,
        **_collect_profile_facts(own, profile),
    )


def _collect_profile_facts(own: dict[str, Any], profile: Any) -> dict[str, Any]:
    """Return the facts about printer and material, as far as the file has them."""
    facts: dict[str, Any] = {}
    if "printer" in own:
        printer = profile.printer
        facts = {"printer": printer.name, "flavour": printer.flavour, "nozzle": printer.nozzle_diameter}
    if "material" in own:
        facts["material"] = profile.material.type or profile.material.name
    return facts


class _ExtrusionBox:
    """The box of all extrusions that move in x or y, and the length of filament that they use."""

    def __init__(self) -> None:
        self.low: tuple[float, float, float] | None = None
        self.high: tuple[float, float, float] | None = None
        self.filament = 0.0

    def add(self, moves: Moves) -> None:
        """Add the next block of moves."""
        import numpy as np  # noqa: PLC0415 - slow

        lays = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
        if not lays.any():
            return
        ends, delta = moves.end[lays], moves.delta[lays]
        points = np.concatenate([ends, ends - delta[:, :3]])
        low, high = points.min(axis=0), points.max(axis=0)
        if self.low is not None and self.high is not None:
            low, high = np.minimum(low, self.low), np.maximum(high, self.high)
        x0, y0, z0 = np.round(low, 3).tolist()
        x1, y1, z1 = np.round(high, 3).tolist()
        self.low, self.high = (x0, y0, z0), (x1, y1, z1)
        self.filament += float(delta[:, 3].sum())


def format_facts(facts: FileFacts) -> str:
    """Return facts as text for the database."""
    return json.dumps(as_dict(facts))


def parse_facts(text: str) -> FileFacts:
    """Return facts from their text; facts of an earlier version lack what was added since."""
    values = json.loads(text)
    for key in ("low", "high"):
        values[key] = None if values.get(key) is None else tuple(values[key])
    return FileFacts(**{key: value for key, value in values.items() if key in FileFacts.__struct_fields__})
