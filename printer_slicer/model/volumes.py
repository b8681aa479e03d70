"""Volumes that do not print but steer the print: support enforcers and blockers, negative volumes, painted facets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import NoneType
from typing import Any, Final

import numpy as np

from printer_slicer.arguments import check_argument
from printer_slicer.arrays import Float, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.model.part import Mesh
from printer_slicer.values import Struct, field, force_setattr

__all__ = ["VolumeSections", "Volumes"]

_MESHES: Final = ("enforce", "block", "negative")
_PAINTED: Final = ("enforced_facets", "blocked_facets")


class Volumes(Struct, frozen=True, eq=False):
    """Volumes and painted facets that belong to a mesh, in the coordinates of that mesh.

    Painted facets are kept as triangles of their own, so that a repair of the mesh cannot mix them up.

    Attributes:
        enforce: closed meshes; overhangs within them get supports.
        block: closed meshes; overhangs within them get none.
        negative: closed meshes that are cut out of the part.
        enforced_facets: (P, 3, 3) mm, the pieces of the surface that are painted to get a support.
        blocked_facets: (Q, 3, 3) mm, the pieces of the surface that are painted to get none.
        modifiers: closed meshes with settings of their own; overrides refer to their names. Where several overlap, the
            last one counts.
    """

    enforce: Mesh | None = None
    block: Mesh | None = None
    negative: Mesh | None = None
    enforced_facets: Float = field(default_factory=lambda: np.zeros((0, 3, 3)))
    blocked_facets: Float = field(default_factory=lambda: np.zeros((0, 3, 3)))
    modifiers: tuple[Mesh, ...] = ()

    def __post_init__(self) -> None:
        for name in _MESHES:
            check_argument(name, getattr(self, name), (Mesh, NoneType))
        force_setattr(self, "modifiers", tuple(self.modifiers))
        for mesh in self.modifiers:
            check_argument("modifiers", mesh, Mesh)
        for name in _PAINTED:
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (-1, 3, 3)))

    def __repr__(self) -> str:
        meshes = [f"{name} {mesh.n_facets}" for name in _MESHES if (mesh := getattr(self, name))]
        painted = [f"{name} {len(getattr(self, name))}" for name in _PAINTED if len(getattr(self, name))]
        modifiers = [f"{mesh.name!r} {mesh.n_facets}" for mesh in self.modifiers]
        return f"<Volumes: {', '.join(meshes + modifiers + painted) or 'none'}>"

    @property
    def has_enforcers(self) -> bool:
        """Whether a volume or a painted facet asks for supports."""
        return self.enforce is not None or len(self.enforced_facets) > 0

    @property
    def has_blockers(self) -> bool:
        """Whether a volume or a painted facet forbids supports."""
        return self.block is not None or len(self.blocked_facets) > 0

    @property
    def is_empty(self) -> bool:
        """Whether there is neither a volume nor a painted facet."""
        return not (self.has_enforcers or self.has_blockers or self.negative is not None or self.modifiers)

    def map_triangles(self, change: Callable[[Float], Float]) -> Volumes:
        """Return the volumes with all triangles changed by a function that takes and returns (F, 3, 3) mm."""
        meshes: dict[str, Any] = {
            name: mesh and Mesh(change(mesh.triangles), mesh.name)
            for name in _MESHES
            for mesh in [getattr(self, name)]
        }
        modifiers = tuple(Mesh(change(mesh.triangles), mesh.name) for mesh in self.modifiers)
        painted = {name: change(getattr(self, name)) for name in _PAINTED}
        return Volumes(**meshes | painted, modifiers=modifiers)

    def moved(self, by: Float) -> Volumes:
        """Return the volumes shifted by (x, y, z) mm."""
        return self.map_triangles(lambda triangles: triangles + by)

    @classmethod
    def joined(cls, several: Sequence[Volumes | None]) -> Volumes | None:
        """Join the volumes of several meshes; None if there are none."""
        given = [one for one in several if one is not None and not one.is_empty]
        if len(given) < 2:
            return given[0] if given else None
        meshes: dict[str, Any] = {name: _join([getattr(one, name) for one in given]) for name in _MESHES}
        painted = {name: np.concatenate([getattr(one, name) for one in given]) for name in _PAINTED}
        return cls(**meshes | painted, modifiers=tuple(mesh for one in given for mesh in one.modifiers))


def _join(meshes: Sequence[Mesh | None]) -> Mesh | None:
    """Join meshes into one; None if there are none."""
    given = [mesh for mesh in meshes if mesh is not None]
    if len(given) < 2:
        return given[0] if given else None
    return Mesh(np.concatenate([mesh.triangles for mesh in given]), given[0].name)


class VolumeSections(Struct, frozen=True, eq=False):
    """The places of each layer where supports are asked for or forbidden.

    Attributes:
        enforce: within enforcers, or below facets that are painted to get a support.
        block: within blockers, or below facets that are painted to get none.
    """

    enforce: Areas
    block: Areas
