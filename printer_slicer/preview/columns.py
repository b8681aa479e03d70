"""The moves of a print as a viewer shows them, one array per property."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.values import Struct, force_setattr

__all__ = [
    "DERETRACTION",
    "EXTRUSION",
    "JUMP",
    "NO_EXTRUSION_ROLES",
    "RETRACTION",
    "TRAVEL",
    "Preview",
    "PreviewRole",
]


class PreviewRole(Struct, frozen=True):
    """A role of moves.

    Attributes:
        name: name for users; of an extrusion, the role name in the file.
        colour: "#rrggbb".
        is_outer: whether the moves are external perimeters, whose starts are the seams.
        is_priming: whether the moves only prepare the nozzle, such as a line at the edge of the bed.
    """

    name: str
    colour: str
    is_outer: bool = False
    is_priming: bool = False


JUMP, TRAVEL, RETRACTION, DERETRACTION, EXTRUSION = range(5)
"""Indices of roles. From `EXTRUSION` on, roles are those of extrusions. A jump is a change of position without a known
way, such as homing."""

NO_EXTRUSION_ROLES: Final = (
    PreviewRole("Jump", "#888888"),
    PreviewRole("Travel", "#c2188b"),
    PreviewRole("Retraction", "#d55e00"),
    PreviewRole("Deretraction", "#0072b2"),
)
"""The roles before `EXTRUSION`, the same in every preview."""


class Preview(Struct, frozen=True, eq=False):
    """The moves of a print in printing order, and its layers.

    A layer is a run of consecutive moves whose extrusions lie at one height, with the travels that lead to them. A file
    that prints objects one after the other has the layers of each object.

    Attributes:
        name: title.
        points: (K + 1, 3) mm, start of the first move and end of each move.
        role: (K,) index into `roles`.
        width, height: (K,) mm, of extrusions; 0 for other moves.
        speed: (K,) requested speed, mm/s.
        tool: (K,) number of the active tool.
        roles: the four of `NO_EXTRUSION_ROLES`, then the roles of extrusions.
        first: (L,) first move of each layer; 0 for the first one.
        layer_z: (L,) mm, top of each layer.
        layer_height: (L,) mm.
        layer_seconds: (L,) time of the moves of each layer, s.
        layer_command: (L,) index of the command of the first move of each layer, among the commands of the file.
    """

    name: str
    points: Float
    role: Int
    width: Float
    height: Float
    speed: Float
    tool: Int
    roles: tuple[PreviewRole, ...]
    first: Int
    layer_z: Float
    layer_height: Float
    layer_seconds: Float
    layer_command: Int

    def __post_init__(self) -> None:
        n_moves, n_layers = len(self.role), len(self.first)
        for name, dtype, shape in (
            ("points", np.float64, (n_moves + 1, 3)),
            ("role", np.int64, (-1,)),
            ("width", np.float64, (n_moves,)),
            ("height", np.float64, (n_moves,)),
            ("speed", np.float64, (n_moves,)),
            ("tool", np.int64, (n_moves,)),
            ("first", np.int64, (-1,)),
            ("layer_z", np.float64, (n_layers,)),
            ("layer_height", np.float64, (n_layers,)),
            ("layer_seconds", np.float64, (n_layers,)),
            ("layer_command", np.int64, (n_layers,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def n_moves(self) -> int:
        """Number of moves."""
        return len(self.role)

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.first)

    @property
    def is_extrusion(self) -> Bool:
        """Mask (K,) of extrusions."""
        return self.role >= EXTRUSION

    @property
    def flow(self) -> Float:
        """Volume flow (K,) at the requested speed, mm³/s; 0 for moves that are not extrusions."""
        is_round = self.width < self.height
        section = np.where(is_round, pi * self.width**2 / 4, bead.cross_section(self.width, self.height))
        return np.asarray(section * self.speed)
