"""Read the preview of a print from G-code of any slicer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.commands import reject_binary_gcode
from printer_slicer.drawing.extrusion_kinds import name_kind
from printer_slicer.errors import UsageError
from printer_slicer.gcode import Moves
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions, extrusions_and_moves_of_gcode
from printer_slicer.inspection.coverage.layer_extrusions import FileLayers, file_layers_of
from printer_slicer.inspection.coverage.stack import stack_extrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.preview.columns import (
    DERETRACTION,
    EXTRUSION,
    JUMP,
    NO_EXTRUSION_ROLES,
    RETRACTION,
    TRAVEL,
    Preview,
    PreviewRole,
)

__all__ = ["read_preview"]

_MAX_ROLES = 200  # of extrusions; the format has a byte for a role
_EQUAL = 1e-6  # mm; positions that differ by less are the same


def read_preview(
    text: bytes, name: str, limits: MotionLimits, *, filament_diameter: float | None = None
) -> Preview:
    """Return the preview of a print.

    Args:
        text: G-code of any slicer.
        name: title; the name of the file in messages.
        limits: limits of the machine, for the times of layers.
        filament_diameter: mm; None takes the value in the text, or 1.75.

    Raises:
        UsageError: the text extrudes nothing, or is binary.
    """
    reject_binary_gcode(text, name)
    gcode, moves, extruding = extrusions_and_moves_of_gcode(text, filament_diameter=filament_diameter)
    layers = file_layers_of(gcode, stack_extrusions(gcode.beads))
    if not layers.n_layers:
        raise UsageError(f"{name}: no extrusion of a part found", remedy="Check that the file has E values")
    role, roles = _find_roles(moves, gcode, extruding)
    first, level = _find_layer_starts(layers, extruding)
    seconds = np.add.reduceat(moves.durations(limits), first)
    start = moves.end - moves.delta[:, :3]
    jump = np.flatnonzero((np.abs(start[1:] - moves.end[:-1]) > _EQUAL).any(axis=1)) + 1
    width, height = np.zeros(len(role)), np.zeros(len(role))
    width[extruding], height[extruding] = layers.beads.width, np.nan_to_num(layers.beads.height)
    return Preview(
        name=name,
        points=np.concatenate([start[:1], np.insert(moves.end, jump, start[jump], axis=0)]),
        role=np.insert(role, jump, JUMP),
        width=np.insert(width, jump, 0.0),
        height=np.insert(height, jump, 0.0),
        speed=np.insert(moves.speed, jump, 0.0),
        tool=np.insert(moves.tool, jump, moves.tool[jump]),
        roles=roles,
        first=first + np.searchsorted(jump, first),
        layer_z=layers.top[level],
        layer_height=(layers.top - layers.bottom)[level],
        layer_seconds=seconds,
        layer_command=moves.line[first],
    )


def _find_roles(moves: Moves, gcode: GcodeExtrusions, extruding: Int) -> tuple[Int, tuple[PreviewRole, ...]]:
    """Return the role (K,) of each move as an index, and the roles; `extruding` (B,) are the moves that extrude."""
    pairs = np.stack([gcode.name, gcode.beads.purpose], axis=1)
    kinds, kind = np.unique(pairs, axis=0, return_inverse=True)
    named = [
        PreviewRole(
            *name_kind(gcode.names[index], Purpose(purpose)),
            is_outer=purpose == Purpose.EXTERNAL_PERIMETER,
            is_priming=purpose == Purpose.CUSTOM,
        )
        for index, purpose in kinds.tolist()
    ]
    roles = list(dict.fromkeys(named))
    if len(roles) > _MAX_ROLES:
        roles = [*roles[:_MAX_ROLES], PreviewRole(*name_kind("Other", Purpose.UNKNOWN))]
    number = {one: i for i, one in enumerate(roles)}
    of_kind = np.array([number.get(one, len(roles) - 1) for one in named], np.int64)
    role = _find_roles_without_extrusion(moves.delta)
    role[extruding] = EXTRUSION + of_kind[kind.ravel()]
    return role, (*NO_EXTRUSION_ROLES, *roles)


def _find_roles_without_extrusion(delta: Float) -> Int:
    """Return the role (K,) of moves (K, 4) if they are not extrusions."""
    is_still = (np.abs(delta[:, :3]) <= _EQUAL).all(axis=1)
    fed = delta[:, 3]
    return np.where(is_still & (fed < 0), RETRACTION, np.where(is_still & (fed > 0), DERETRACTION, TRAVEL))


def _find_layer_starts(layers: FileLayers, extruding: Int) -> tuple[Int, Int]:
    """Return the first move (L,) of each layer in printing order, and its index (L,) in `layers`.

    A layer starts after the last extrusion of the layer before. Extrusions outside all layers belong to the layer that
    is being printed.
    """
    known = np.flatnonzero(layers.level >= 0)
    level = layers.level[known]
    change = np.flatnonzero(np.diff(level)) + 1
    first = extruding[known[change] - 1] + 1
    return np.append(0, first), level[np.append(0, change)]
