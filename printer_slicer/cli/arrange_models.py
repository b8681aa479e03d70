"""Arrange the models of a command line on plates, and tell where each part is."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from printer_slicer.errors import PartError, UsageError
from printer_slicer.placing import Placement
from printer_slicer.texts import list_with_counts

if TYPE_CHECKING:
    from printer_slicer.arranging import Arrangement
    from printer_slicer.model import Mesh
    from printer_slicer.profile import Printer, Profile

__all__ = [
    "ArrangedPlates",
    "arrange_models",
    "check_plate_number",
    "count_fused_copies",
    "describe_other_plates",
    "explain_arranging",
    "is_arranging_requested",
    "reject_positions_with_copies",
]

_MAX_NAMED = 6  # parts of a plate


class ArrangedPlates(NamedTuple):
    """Parts that are arranged on plates.

    Attributes:
        meshes: one for each plate.
        placement: position of each mesh on the bed.
        parts: facts about each part, for JSON: name, plate (from 1), rotation and centre.
        shapes: the parts as they were given; copies are the same mesh.
        places: their places.
        gap: smallest distance between parts, mm.
    """

    meshes: tuple[Mesh, ...]
    placement: Placement
    parts: tuple[dict[str, Any], ...]
    shapes: tuple[Mesh, ...]
    places: Arrangement
    gap: float

    def describe(self) -> str:
        """Return a sentence about the numbers of parts and plates."""
        many = "1 plate" if len(self.meshes) == 1 else f"{len(self.meshes)} plates"
        parts = "1 part" if len(self.parts) == 1 else f"{len(self.parts)} parts"
        return f"arranged {parts} on {many}, at least {self.gap:g} mm apart"


def is_arranging_requested(arguments: argparse.Namespace) -> bool:
    """Return whether options ask for arranging: --arrange, --gap, or copies of a model."""
    has_copies = arguments.copies > 1 or len(set(arguments.models)) < len(arguments.models)
    return arguments.arrange or arguments.gap is not None or has_copies


def count_fused_copies(arguments: argparse.Namespace) -> int:
    """Return how many copies are printed of the part that --fuse makes of all models.

    Raises:
        UsageError: the models have different numbers of copies.
    """
    counts = Counter(arguments.models)
    if len(set(counts.values())) > 1:
        raise UsageError(
            "--fuse: the models have different numbers of copies",
            remedy="Give the same number for all, or use --copies N",
        )
    return int(arguments.copies * counts[arguments.models[0]])


def reject_positions_with_copies(arguments: argparse.Namespace) -> None:
    """Reject positions from the files for parts that are arranged.

    Raises:
        UsageError: --as-placed is given with copies, or with --gap.
    """
    if arguments.as_placed and is_arranging_requested(arguments):
        what = "--gap" if arguments.gap is not None else "several copies of a model"
        raise UsageError(
            f"--as-placed: positions from the files cannot be used with {what}",
            remedy="Leave out --as-placed",
        )


def explain_arranging(
    arguments: argparse.Namespace, meshes: Sequence[Mesh], overlaps: str, printer: Printer
) -> str:
    """Return why parts cannot be printed at the positions in their files; empty if they can.

    Args:
        arguments: the command line.
        meshes: the parts at the positions in their files.
        overlaps: description of their overlaps; empty without any.
        printer: gives the size of the bed.

    Raises:
        PartError: parts overlap, but a position is given with --center or --as-placed.
    """
    is_placed = arguments.as_placed or arguments.center is not None
    if overlaps and is_placed:
        flag = "--as-placed" if arguments.as_placed else "--center"
        raise PartError(
            f"{overlaps}, at the positions in their files",
            remedy=f"Leave out {flag} to arrange the parts, or print them as one part with --fuse",
        )
    if overlaps:
        return f"{overlaps}, at the positions in their files"
    low, high = (np.array([mesh.bounds[side, :2] for mesh in meshes]) for side in (0, 1))
    extent, most = high.max(axis=0) - low.min(axis=0), printer.print_volume[:2]
    if len(meshes) > 1 and not is_placed and (extent > most).any():
        return "together, the parts at the positions in their files do not fit the bed"
    return ""


def arrange_models(arguments: argparse.Namespace, meshes: Sequence[Mesh], profile: Profile) -> ArrangedPlates:
    """Arrange parts on plates.

    Args:
        arguments: the command line.
        meshes: the parts; copies are the same mesh.
        profile: printer and settings.

    Raises:
        PartError: a part does not fit the bed.
    """
    from printer_slicer.plates import choose_gap, find_places, make_plates

    gap = choose_gap(meshes, profile) if arguments.gap is None else float(arguments.gap)
    places = find_places(meshes, profile, gap)
    plates = make_plates(meshes, places, drop=arguments.drop)
    facts = tuple(_list_part_facts(meshes, places, plates))
    placement = Placement(arguments.center, arguments.center is None, arguments.drop)
    return ArrangedPlates(plates, placement, facts, tuple(meshes), places, gap)


def _list_part_facts(
    meshes: Sequence[Mesh], places: Arrangement, plates: Sequence[Mesh]
) -> Iterator[dict[str, Any]]:
    """Yield the facts about the place of each part: centre of its bounding box on the bed, mm, and rotation."""
    n_before = [0] * len(plates)
    for mesh, plate, angle in zip(meshes, places.plate.tolist(), places.angle.tolist(), strict=True):
        n_own = max(len(mesh.objects), 1)
        own = plates[plate].objects[n_before[plate] : n_before[plate] + n_own]
        n_before[plate] += n_own
        boxes = [np.array([item.low, item.high]) for item in own] or [plates[plate].bounds]
        low = np.min([box[0] for box in boxes], axis=0)
        high = np.max([box[1] for box in boxes], axis=0)
        x, y = ((low + high)[:2] / 2).tolist()
        yield {
            "name": mesh.name,
            "plate": plate + 1,
            "rotation_deg": angle,
            "x": round(x, 4),
            "y": round(y, 4),
        }


def check_plate_number(arguments: argparse.Namespace, count: int) -> None:
    """Check that there is a plate with the number of --plate.

    Raises:
        UsageError: there is not.
    """
    if arguments.plate is not None and arguments.plate > count:
        have = "all parts are on 1 plate" if count == 1 else f"the parts need {count} plates"
        raise UsageError(f"--plate {arguments.plate}: {have}", remedy="Choose a smaller number")


def describe_other_plates(parts: Sequence[dict[str, Any]]) -> str:
    """Return which parts are on the plates after the first, such as `plate 2: lid, 3 x box`."""
    described = []
    for number in sorted({part["plate"] for part in parts if part["plate"] > 1}):
        listed = list_with_counts(part["name"] for part in parts if part["plate"] == number)
        more = [f"{len(listed) - _MAX_NAMED} others"] if len(listed) > _MAX_NAMED else []
        described.append(f"plate {number}: {', '.join([*listed[:_MAX_NAMED], *more])}")
    return "; ".join(described)
