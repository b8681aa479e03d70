"""Scale, rotate and join parts, and place them on the bed.

Facets are processed in blocks, so a large mesh is never in memory more than twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import isfinite
from typing import Final

import numpy as np

from printer_slicer.arguments import check_argument, check_arguments
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError, UsageError
from printer_slicer.geometry import intersection
from printer_slicer.geometry.vectors import cosine_and_sine
from printer_slicer.mesh_io import UNITS, unit_advice
from printer_slicer.mesh_io.soundness import LARGEST, facet_blocks
from printer_slicer.mesh_io.units import UNIT_NAMES
from printer_slicer.model import Mesh, PlateObject, Volumes
from printer_slicer.profile import Printer
from printer_slicer.values import Struct, replace

__all__ = ["IN_THE_MIDDLE", "Placement", "join", "place", "transform"]

_SLACK: Final = 1e-6  # mm


class Placement(Struct, frozen=True):
    """The position of a part on the bed.

    Attributes:
        center: x and y of the centre of the part's bounding box on the bed, mm; None: the middle of the bed.
        as_placed: use x and y of the file; `center` is ignored.
        drop: move the part up or down onto z = 0; otherwise use z of the file.
        unit: assumed unit of the file, for advice if the part does not fit; empty: unknown or certain.
        unit_given: whether the user specified the unit.
        scale: scale factors already applied, as the user wrote them, such as "2", "50%" or "1,1,2"; also for advice if
            the part does not fit.
    """

    center: tuple[float, float] | None = None
    as_placed: bool = False
    drop: bool = True
    unit: str = "mm"
    unit_given: bool = False
    scale: str = ""


IN_THE_MIDDLE: Final = Placement()
"""The default placement: on the middle of the bed."""


@check_arguments(mesh=Mesh, printer=Printer, placement=Placement)
def place(mesh: Mesh, printer: Printer, placement: Placement = IN_THE_MIDDLE) -> Mesh:
    """Move a part to its position on the bed.

    Args:
        mesh: the part, anywhere.
        printer: gives the bed and the printable height.
        placement: position on the bed.

    Raises:
        PartError: the part is larger than the print volume, or lies outside it or below the bed.
    """
    low, high = mesh.bounds
    _check_size(mesh.name, high - low, printer, placement)
    by = np.zeros(3)
    if not placement.as_placed:
        middle = np.mean(printer.corners, axis=0) if placement.center is None else placement.center
        by[:2] = np.asarray(middle) - (low + high)[:2] / 2
    if placement.drop:
        by[2] = -low[2]
    _check_position(mesh.name, low + by, high + by, printer, placement)
    move = partial(_move_rounded, by=by)
    triangles = move(mesh.triangles)
    _check_excluded_areas(mesh.name, triangles, printer)
    volumes = mesh.volumes and mesh.volumes.map_triangles(move)
    items = tuple(replace(item.moved(by), volumes=item.map_volumes(move).volumes) for item in mesh.objects)
    return Mesh(triangles, mesh.name, items, volumes)


def _check_excluded_areas(name: str, triangles: Float, printer: Printer) -> None:
    """Check that a placed part (F, 3, 3) is outside the excluded areas of the bed.

    Raises:
        PartError: it is not; the message names the place.
    """
    if not printer.excluded_areas:
        return
    from printer_slicer.excluded_areas import read_excluded_areas  # noqa: PLC0415 - few beds have excluded areas
    from printer_slicer.surface.top_view import project_from_above  # noqa: PLC0415 - few beds have excluded areas

    common = intersection(project_from_above(Mesh(triangles)), read_excluded_areas(printer))
    if common.n_rings:
        low, high = (corner.reshape(-1, 2) for corner in common.boxes())
        size = high.max(axis=0) - low.min(axis=0)
        x, y = (low.min(axis=0) + size / 2).tolist()
        raise PartError(
            f"{name}: the part or its overhang is in an excluded area of the bed of {printer.name!r}, near x {x:.4g} y "
            f"{y:.4g}, over {size[0]:.3g} x {size[1]:.3g} mm",
            remedy="Let `arrange` find a place, set the position with `center`, or change printer.excluded_areas",
        )


def _move_rounded(triangles: Float, by: Float) -> Float:
    """Return triangles (F, 3, 3) shifted by (3,) mm, rounded to 1 nm.

    Points that differ only by rounding errors become equal, wherever the part is in its file.
    """
    placed = np.zeros_like(triangles)
    for block in facet_blocks(len(triangles)):
        np.add(triangles[block], by, out=placed[block])
        np.round(placed[block], 6, out=placed[block])
    return placed


def _check_size(name: str, size: Float, printer: Printer, placement: Placement) -> None:
    """Check that the part is not larger than the print volume."""
    room = np.array(printer.print_volume)
    if not (size > room + _SLACK).any():
        return
    fits = _multiply_factors(placement.scale or "1", float((room / np.maximum(size, _SLACK)).min()))
    advice = unit_advice(size, placement.unit, room) if placement.unit in UNITS else ""
    if not advice and placement.unit in UNITS and not placement.unit_given:
        advice = f"is it in {UNIT_NAMES[placement.unit]}?"
    raise PartError(
        f"{name}: {size[0]:.5g} x {size[1]:.5g} x {size[2]:.5g} mm does not fit {printer.name!r}, "
        f"which prints {room[0]:g} x {room[1]:g} x {room[2]:g} mm",
        remedy="; ".join(
            [
                f"Choose a larger printer, or scale the part: `scale={fits}` would just fit",
                *([advice] if advice else []),
            ]
        ),
    )


def _multiply_factors(factors: str, by: float) -> str:
    """Multiply scale factors, given as text, by `by`; round down to two digits so that the part still fits."""
    made = []
    for word in factors.split(","):
        factor = by * float(word.strip().removesuffix("%"))
        step = 10.0 ** (np.floor(np.log10(factor)) - 1)
        made.append(
            f"{np.floor(factor / step * (1 + 1e-12)) * step:.6g}{'%' if word.strip().endswith('%') else ''}"
        )
    return ",".join(made)


def _check_position(name: str, low: Float, high: Float, printer: Printer, placement: Placement) -> None:
    """Check that the part lies within the print volume."""
    flag, instead = (
        ("`as_placed`", "set the position with `center`")
        if placement.as_placed
        else ("`center`", "choose another position")
    )
    corners = np.array(printer.free_corners, dtype=np.float64)
    bed = "the bed" if not printer.bed_margin else "the bed without its margin"
    for axis, letter in enumerate("xy"):
        if low[axis] < corners[0, axis] - _SLACK or high[axis] > corners[1, axis] + _SLACK:
            raise PartError(
                f"{name}: the part extends from {letter} {low[axis]:.5g} to {high[axis]:.5g} mm, but {bed} of "
                f"{printer.name!r} goes from {corners[0, axis]:g} to {corners[1, axis]:g} mm",
                remedy=f"Omit {flag} to use the middle of the bed, or {instead}",
            )
    if low[2] < -_SLACK:
        raise PartError(
            f"{name}: the part extends {-low[2]:.5g} mm below the bed",
            remedy="Omit `drop=False` to place the part on the bed, or cut off its bottom in a CAD program",
        )
    if high[2] > printer.bed_z + _SLACK:
        raise PartError(
            f"{name}: the part extends up to z {high[2]:.5g} mm, but {printer.name!r} prints only up to "
            f"{printer.bed_z:g} mm",
            remedy="Omit `drop=False` to place the part on the bed",
        )


@check_arguments(mesh=Mesh)
def transform(
    mesh: Mesh,
    *,
    scale: float | tuple[float, float, float] = 1.0,
    rotate: tuple[float, float, float] = (0, 0, 0),
) -> Mesh:
    """Scale a part, then rotate it about x, then y, then z; the origin of the file stays fixed.

    Args:
        mesh: the part.
        scale: one factor, or one each for x, y and z; greater than 0.
        rotate: degrees about the fixed axes x, y and z, counter-clockwise seen against the axis. Quarter turns are
            exact.

    Raises:
        UsageError: a factor is not greater than 0 or moves the part beyond 10 km, or an angle is not finite.
    """
    factors = _read_three(
        "scale", scale, "a factor such as 0.5 for 50 %, or one for each axis such as (1, 1, 2)"
    )
    angles = _read_three("rotate", np.atleast_1d(rotate), "three angles in degrees such as (0, 0, 90)")
    if not (np.isfinite(factors).all() and (factors > 0).all()):
        raise UsageError(
            f"scale {scale}: each factor must be greater than 0",
            remedy="Choose a factor greater than 0; to mirror the part, use a CAD program",
        )
    far = factors * np.abs(mesh.bounds).max(axis=0)
    if far.max() > LARGEST:
        raise UsageError(
            f"scale {_format_factors(factors)}: this moves {mesh.name} to {far.max():.3g} mm from the origin of its "
            "file",
            remedy=f"Choose a smaller factor; coordinates up to {LARGEST / 1e6:g} km are allowed",
        )
    if not all(map(isfinite, angles)):
        raise UsageError(
            f"rotate {rotate}: these are not three angles",
            remedy="Give three finite angles in degrees, about x, y and z",
        )
    matrix = np.diag(factors)
    for axis, angle in enumerate(angles.tolist()):
        # The first matrix product loads 18 MiB of libraries, so it is skipped where no rotation is needed.
        matrix = _make_rotation_matrix(axis, angle) @ matrix if angle % 360.0 else matrix
    if np.array_equal(matrix, np.eye(3)):
        return mesh
    made = _apply_matrix(mesh.triangles, matrix)
    change = partial(_apply_matrix, matrix=matrix)
    volumes = mesh.volumes and mesh.volumes.map_triangles(change)
    items = tuple(item.map_volumes(change) for item in mesh.objects)
    return Mesh(made, mesh.name, _update_envelopes(items, made), volumes)


def _apply_matrix(triangles: Float, matrix: Float) -> Float:
    """Return triangles (F, 3, 3) multiplied by a matrix (3, 3) for column vectors."""
    made = np.zeros_like(triangles)
    plain = np.array_equal(matrix, np.diag(np.diag(matrix)))
    for block in facet_blocks(len(triangles)):
        part = triangles[block]
        made[block] = part * np.diag(matrix) if plain else part @ matrix.T
    return made


def _read_three(name: str, value: object, example: str) -> Float:
    """Return an argument as three numbers; one number stands for all three.

    Raises:
        UsageError: it is not a number or three numbers.
    """
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape not in ((), (3,)):
        raise UsageError(f"the argument `{name}` must be numbers, not {value!r}", remedy=f"Pass {example}")
    return np.broadcast_to(numbers, 3)


def _format_factors(factors: Float) -> str:
    """Format factors as the user writes them."""
    return ",".join(
        f"{factor:g}" for factor in (factors[:1] if (factors == factors[0]).all() else factors).tolist()
    )


def _make_rotation_matrix(axis: int, angle: float) -> Float:
    """Return the (3, 3) rotation matrix about an axis, for column vectors; angle in degrees."""
    c, s = cosine_and_sine(angle)
    one, two = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[one, one] = turn[two, two] = c
    turn[one, two], turn[two, one] = -s, s
    return turn


def join(meshes: Sequence[Mesh]) -> Mesh:
    """Join several parts into one mesh with one object per part; positions stay the same.

    Volumes that apply to all objects of a part apply only to these objects.

    Raises:
        UsageError: the list is empty.
    """
    check_argument("meshes", meshes, (list, tuple))
    for mesh in meshes:
        check_argument("meshes", mesh, Mesh)
    if not meshes:
        raise UsageError("no part to join", remedy="Pass at least one part")
    if len(meshes) == 1:
        return meshes[0]
    name = f"{meshes[0].name} and {len(meshes) - 1} more"
    items: list[PlateObject] = []
    begin = 0
    for mesh in meshes:
        own = mesh.objects or (PlateObject.of(mesh.name, mesh.bounds, 0, mesh.n_facets),)
        if len(own) == 1:  # all facets belong to a single object, even after a repair
            own = (replace(own[0], first=0, count=mesh.n_facets),)
        for item in own:
            volumes = Volumes.joined([item.volumes, mesh.volumes])
            items.append(replace(item.with_facets_before(begin), volumes=volumes))
        begin += mesh.n_facets
    return Mesh(np.concatenate([mesh.triangles for mesh in meshes]), name, tuple(items))


def _update_envelopes(items: Sequence[PlateObject], triangles: Float) -> tuple[PlateObject, ...]:
    """Return the objects with their bounding boxes computed again after their facets moved."""
    made = []
    for item in items:
        # A single object has all facets, even after a repair.
        facets = triangles if len(items) == 1 else triangles[item.facets]
        made.append(PlateObject.of(item.name, Mesh(facets).bounds, item.first, item.count, item.volumes))
    return tuple(made)
