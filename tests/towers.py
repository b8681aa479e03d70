"""A part with two towers that stand apart, and settings that give each its own layers."""

from __future__ import annotations

import numpy as np
import trimesh

from printer_slicer.model import Mesh
from printer_slicer.profile import Profile
from tests.parts import plain

__all__ = ["optimal", "towers"]


def solid(made: trimesh.Trimesh) -> Mesh:
    """The part, standing on the bed."""
    return Mesh(np.asarray(made.triangles, np.float64), "towers").moved((20.0, 20.0, 0.0))


def towers(roof: float = 0.0) -> Mesh:
    """A base with a broad tower and a ball on a thin post, and perhaps a roof over both."""
    solids = [
        trimesh.creation.box(bounds=[(0, 0, 0), (34, 16, 2)]),
        trimesh.creation.box(bounds=[(1, 1, 1.5), (17, 15, 14)]),
        trimesh.creation.icosphere(3, 5.0).apply_translation((26, 8, 7.5)),
        trimesh.creation.box(bounds=[(24, 6, 1.5), (28, 10, 14)]),
    ]
    if roof:
        solids.append(trimesh.creation.box(bounds=[(0, 0, 13.5), (34, 16, 14 + roof)]))
    return solid(trimesh.boolean.union(solids, engine="manifold"))


def optimal(**changes: object) -> Profile:
    """The optimal planner with plans for features."""
    usual = {
        "planner__kind": "optimal",
        "planner__stacks": "features",
        "tolerance": 0.12,
        "thickest_layer": 0.3,
    }
    return plain(**(usual | changes))
