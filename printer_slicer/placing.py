"""Where parts stand: scaled and turned, joined to one plate, put on the bed.

Everything works block by block: of a large mesh there is never more than the one given and the one made.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, isfinite, radians, sin
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.errors import PartError, UsageError
from printer_slicer.mesh_io import UNITS, unit_advice
from printer_slicer.mesh_io.soundness import LARGEST, blocks
from printer_slicer.mesh_io.units import SPOKEN
from printer_slicer.model import Mesh, PlateObject
from printer_slicer.profile import Printer

__all__ = ["IN_THE_MIDDLE", "Placement", "joined", "place", "transformed"]

_SLACK: Final = 1e-6  # mm
_QUARTERS: Final = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
"""Cosine and sine of angles that must leave flats flat."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Where a part is put.

    Attributes:
        center: x and y on the bed, mm, where the middle of its envelope goes; None: the middle of the bed.
        as_placed: x and y of the file are x and y on the bed; `center` has no meaning then.
        drop: it is put down, or lifted, until it stands on z = 0; otherwise z of the file is z of the printer.
        unit: what the numbers of the file were taken to mean, for advice on parts that do not fit; empty: not known,
            or nothing to doubt.
        unit_given: whether a person said so.
        scale: factors by which the part was made larger already, as they were written, such as "2", "50%" or "1,1,2";
            for the same advice.
    """

    center: tuple[float, float] | None = None
    as_placed: bool = False
    drop: bool = True
    unit: str = "mm"
    unit_given: bool = False
    scale: str = ""


IN_THE_MIDDLE: Final = Placement()
"""On the bed, in its middle."""


def place(mesh: Mesh, printer: Printer, placement: Placement = IN_THE_MIDDLE) -> Mesh:
    """The part on the bed, by default standing in its middle.

    Args:
        mesh: the part, anywhere.
        printer: whose bed it is.
        placement: where on it.

    Raises:
        PartError: the part is larger than the bed, higher than the printer, beside the bed or under it.
    """
    low, high = mesh.bounds
    _check_size(mesh.name, high - low, printer, placement)
    by = np.zeros(3)
    if not placement.as_placed:
        middle = np.mean(printer.corners, axis=0) if placement.center is None else placement.center
        by[:2] = np.asarray(middle) - (low + high)[:2] / 2
    if placement.drop:
        by[2] = -low[2]
    _check_place(mesh.name, low + by, high + by, printer, placement)
    placed = np.zeros_like(mesh.triangles)
    for block in blocks(mesh.n_facets):
        # To a nanometre: where the part was drawn must not decide ties between points that are the same but for
        # rounding.
        np.add(mesh.triangles[block], by, out=placed[block])
        np.round(placed[block], 6, out=placed[block])
    return Mesh(placed, mesh.name, tuple(item.moved(by) for item in mesh.objects))


def _check_size(name: str, size: Float, printer: Printer, placement: Placement) -> None:
    """Refuse what fits nowhere on the bed."""
    room = np.array([printer.bed_x, printer.bed_y, printer.bed_z])
    if not (size > room + _SLACK).any():
        return
    fits = _rescaled(placement.scale or "100%", float((room / np.maximum(size, _SLACK)).min()))
    advice = unit_advice(size, placement.unit, room) if placement.unit in UNITS else ""
    if not advice and placement.unit in UNITS and not placement.unit_given:
        advice = f"is it in {SPOKEN[placement.unit]}?"
    raise PartError(
        f"{name}: {size[0]:.5g} x {size[1]:.5g} x {size[2]:.5g} mm does not fit {printer.name!r}, "
        f"which prints {room[0]:g} x {room[1]:g} x {room[2]:g} mm",
        remedy="; ".join(
            [
                f"choose a larger printer, or scale the part: --scale {fits} would just fit",
                *([advice] if advice else []),
            ]
        ),
    )


def _rescaled(factors: str, by: float) -> str:
    """Factors as they were written, each times another factor: two digits are enough, and never too large."""
    made = []
    for word in factors.split(","):
        factor = by * float(word.strip().removesuffix("%"))
        step = 10.0 ** (np.floor(np.log10(factor)) - 1)
        made.append(
            f"{np.floor(factor / step * (1 + 1e-12)) * step:.6g}{'%' if word.strip().endswith('%') else ''}"
        )
    return ",".join(made)


def _check_place(name: str, low: Float, high: Float, printer: Printer, placement: Placement) -> None:
    """Refuse a part that is beside the bed or under it."""
    flag, instead = (
        ("--as-placed", "say where with --center")
        if placement.as_placed
        else ("--center", "name another place")
    )
    corners = np.array(printer.corners, dtype=np.float64)
    for axis, letter in enumerate("xy"):
        if low[axis] < corners[0, axis] - _SLACK or high[axis] > corners[1, axis] + _SLACK:
            raise PartError(
                f"{name}: reaches from {letter} {low[axis]:.5g} to {high[axis]:.5g} mm, but the bed of "
                f"{printer.name!r} from {corners[0, axis]:g} to {corners[1, axis]:g} mm",
                remedy=f"leave out {flag} for the middle of the bed, or {instead}",
            )
    if low[2] < -_SLACK:
        raise PartError(
            f"{name}: reaches {-low[2]:.5g} mm under the bed",
            remedy="leave out --no-drop to stand it on the bed, or cut it where it shall begin",
        )
    if high[2] > printer.bed_z + _SLACK:
        raise PartError(
            f"{name}: reaches up to z {high[2]:.5g} mm, but {printer.name!r} prints up to {printer.bed_z:g} mm",
            remedy="leave out --no-drop to stand it on the bed",
        )


def transformed(
    mesh: Mesh,
    *,
    scale: float | tuple[float, float, float] = 1.0,
    rotate: tuple[float, float, float] = (0, 0, 0),
) -> Mesh:
    """The part scaled, then turned about x, then about y, then about z; all about the origin of its file.

    Args:
        mesh: the part.
        scale: factor, or one for x, y and z each; over 0.
        rotate: degrees about the fixed axes x, y, z; counter-clockwise seen against the axis. Quarter turns are exact.

    Raises:
        UsageError: a factor that is not over 0 or takes the part beyond 10 km, or a number that is none.
    """
    factors = np.broadcast_to(np.asarray(scale, dtype=np.float64), 3)
    if not (np.isfinite(factors).all() and (factors > 0).all()):
        raise UsageError(f"scale {scale}: not over 0", remedy="mirror a part in the program that made it")
    far = factors * np.abs(mesh.bounds).max(axis=0)
    if far.max() > LARGEST:
        raise UsageError(
            f"scale {_listed(factors)}: takes {mesh.name} to {far.max():.3g} mm from the origin of its file",
            remedy=f"choose a smaller factor: parts up to {LARGEST / 1e6:g} km are read",
        )
    if not all(map(isfinite, rotate)):
        raise UsageError(f"rotate {rotate}: not an angle", remedy="degrees about x, y and z")
    matrix = np.diag(factors)
    for axis, angle in enumerate(rotate):
        # The first product of matrices costs 18 MiB, which most parts can do without.
        matrix = _turn(axis, angle) @ matrix if angle % 360.0 else matrix
    if np.array_equal(matrix, np.eye(3)):
        return mesh
    made = np.zeros_like(mesh.triangles)
    plain = np.array_equal(matrix, np.diag(np.diag(matrix)))
    for block in blocks(mesh.n_facets):
        part = mesh.triangles[block]
        made[block] = part * np.diag(matrix) if plain else part @ matrix.T
    return Mesh(made, mesh.name, _outlined(mesh.objects, made))


def _listed(factors: Float) -> str:
    """As --scale takes them."""
    return ",".join(
        f"{factor:g}" for factor in (factors[:1] if (factors == factors[0]).all() else factors).tolist()
    )


def _turn(axis: int, angle: float) -> Float:
    """(3, 3) for columns: turn about an axis by degrees."""
    c, s = _QUARTERS.get(angle % 360.0, (cos(radians(angle)), sin(radians(angle))))
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[one, one] = turn[two, two] = c
    turn[one, two], turn[two, one] = -s, s
    return turn


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Several parts as one, where they are.

    Raises:
        UsageError: there are none.
    """
    if not meshes:
        raise UsageError("no part to join", remedy="name at least one")
    if len(meshes) == 1:
        return meshes[0]
    name = f"{meshes[0].name} and {len(meshes) - 1} more"
    items: list[PlateObject] = []
    begin = 0
    for mesh in meshes:
        own = mesh.objects or (PlateObject.of(mesh.name, mesh.bounds, 0, mesh.n_facets),)
        items += [item.behind(begin) for item in own]
        begin += mesh.n_facets
    return Mesh(np.concatenate([mesh.triangles for mesh in meshes]), name, tuple(items))


def _outlined(items: Sequence[PlateObject], triangles: Float) -> tuple[PlateObject, ...]:
    """The same things after their facets have been moved about."""
    made = []
    for item in items:
        # Facets of the only thing are all there are, also after a repair.
        facets = triangles if len(items) == 1 else triangles[item.first : item.first + item.count]
        made.append(PlateObject.of(item.name, Mesh(facets).bounds, item.first, item.count))
    return tuple(made)
