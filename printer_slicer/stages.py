"""What becomes of a part: the value of every stage, from the repaired mesh to the moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypedDict

import numpy as np

from printer_slicer.arrays import Float, frozen_array
from printer_slicer.errors import MeshError, UsageError
from printer_slicer.link_limiter import LinkReport
from printer_slicer.model import (
    Labels,
    LayerPlan,
    Mesh,
    Program,
    Regions,
    Repairs,
    Sections,
    Toolpaths,
    Travels,
    Walls,
)
from printer_slicer.placing import Placement
from printer_slicer.profile import Profile
from printer_slicer.progress import Report
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.strategies import Strategies
from printer_slicer.texts import describe_type

__all__ = ["SliceOptions", "Stages", "check_part"]


class SliceOptions(TypedDict, total=False):
    """What may be chosen of how a part is sliced; see `pipeline.slice_stages`."""

    plan: LayerPlan | Sequence[LayerPlan] | None
    placement: Placement
    report: Report
    strict: bool
    strategies: Strategies


def check_part(mesh: object, profile: object) -> None:
    """Refuse what nothing can be made of, before a stage fails over it in words of its own.

    Raises:
        UsageError: the part is no mesh, or the profile none.
        MeshError: it has no facets, or a coordinate that is no number.
    """
    if not isinstance(mesh, Mesh):
        raise UsageError(f"a part is a Mesh, not {describe_type(mesh)}", remedy="read it: ps.load_mesh(path)")
    if not isinstance(profile, Profile):
        raise UsageError(
            f"a profile is a Profile, not {describe_type(profile)}",
            remedy="load it: ps.load_profile(printer)",
        )
    if not mesh.n_facets:
        raise MeshError(f"{mesh.name}: has no facets", remedy="give it triangles (F, 3, 3), mm")
    if not np.isfinite(mesh.bounds).all():
        raise MeshError(
            f"{mesh.name}: a corner has a coordinate that is no number",
            remedy="all of mesh.triangles must be finite, mm",
        )


@dataclass(frozen=True, slots=True, eq=False)
class Stages(SvgRepr):
    """Every value on the way from a part to its moves.

    Attributes:
        part: repaired and placed.
        sections: the solid area of each layer. These, the walls and the regions see the part on the bed; where there is
            a raft, toolpaths, travels and program have its layers before the part's, and the part lifted.
        walls: the perimeters, and what is left inside them.
        regions: that by purpose.
        toolpaths: polylines in the order in which they are printed.
        travels: the ways between them.
        program: the moves.
        link: what it took to stay under the lines per second of the link, if the profile tells them.
        labels: which moves lay which of several things; None where there is one.
        repairs: what was put right, at the places of the mesh that was given.
        shift: (3,) mm from the placed part to where that mesh was.
    """

    part: Mesh
    sections: Sections
    walls: Walls
    regions: Regions
    toolpaths: Toolpaths
    travels: Travels
    program: Program
    link: LinkReport | None = None
    labels: Labels | None = None
    repairs: Repairs = field(default_factory=Repairs)
    shift: Float = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "shift", frozen_array(self.shift, np.float64, (3,)))

    def __repr__(self) -> str:
        values = ("part", "sections", "walls", "regions", "toolpaths", "travels", "program")
        return "\n".join(["<Stages", *(f"  {name}: {getattr(self, name)!r}" for name in values), ">"])

    @property
    def drawable(self) -> object:
        """The moves."""
        return self.program

    @property
    def plan(self) -> LayerPlan:
        """The layers of the part, without those of a raft."""
        return self.sections.plan
