"""The results of all slicing stages, from the repaired mesh to the moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

import numpy as np

from printer_slicer.arguments import check_argument
from printer_slicer.arrays import Float, frozen_array
from printer_slicer.errors import MeshError
from printer_slicer.model import (
    Labels,
    LayerPlan,
    Mesh,
    ObjectStack,
    Overhangs,
    Program,
    Regions,
    Repairs,
    Sections,
    Supports,
    Toolpaths,
    Travels,
    Volumes,
    Walls,
)
from printer_slicer.object_plans import Plans
from printer_slicer.placing import Placement
from printer_slicer.profile import Profile
from printer_slicer.progress import Report
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.strategies import Strategies
from printer_slicer.values import Struct, field, force_setattr

if TYPE_CHECKING:
    from printer_slicer.link_limiter import LinkReport

__all__ = ["SliceOptions", "Stages", "check_part"]


class SliceOptions(TypedDict, total=False):
    """Keyword arguments of `pipeline.slice_stages`."""

    plan: Plans | None
    placement: Placement
    report: Report
    strict: bool
    strict_supports: bool
    strategies: Strategies
    volumes: Volumes | None


def check_part(mesh: Mesh, profile: Profile) -> None:
    """Check the types of part and profile, and that the mesh has valid facets.

    Raises:
        UsageError: `mesh` is not a Mesh, or `profile` is not a Profile.
        MeshError: the mesh has no facets, or a coordinate that is not finite.
    """
    check_argument("mesh", mesh, Mesh)
    check_argument("profile", profile, Profile)
    if not mesh.n_facets:
        raise MeshError(
            f"{mesh.name}: the mesh has no facets", remedy="Pass triangles of shape (F, 3, 3), mm"
        )
    if not np.isfinite(mesh.bounds).all():
        raise MeshError(
            f"{mesh.name}: a coordinate is not a finite number",
            remedy="Check mesh.triangles: all values must be finite, mm",
        )


class Stages(SvgRepr, Struct, frozen=True, eq=False):
    """The result of every stage from a part to its moves.

    Attributes:
        part: the repaired and placed part.
        sections: the solid area of each layer. Sections, walls and regions never contain a raft. With a raft,
            toolpaths, travels and program begin with the layers of the raft, and the part is raised.
        walls: the perimeters, and the area inside them.
        regions: the area inside the perimeters, divided by role.
        toolpaths: polylines in printing order.
        travels: the travel moves between them.
        program: the moves.
        link: changes made to stay within the throughput of the serial link, if the profile sets one.
        labels: the object of each move; None if the part is a single object.
        repairs: repairs of the mesh, in coordinates of the given mesh.
        overhangs: the areas that need supports, whether or not supports are printed; None if not searched for.
        overhangs_without_supports: those of objects that have no supports; None if all have supports.
        supports: the areas of supports, on layers of their own below the raft's lift; None without supports.
        shift: (3,) vector from the placed part to the mesh as it was given, mm.
        stacks: the layer plans, and the objects that have them; a single one if all objects have the same layers. With
            several, the layers of sections, walls and regions are the union of all layers.
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
    overhangs: Overhangs | None = None
    overhangs_without_supports: Overhangs | None = None
    supports: Supports | None = None
    shift: Float = field(default_factory=lambda: np.zeros(3))
    stacks: tuple[ObjectStack, ...] = ()

    def __post_init__(self) -> None:
        force_setattr(self, "shift", frozen_array(self.shift, np.float64, (3,)))

    def __repr__(self) -> str:
        values = ("part", "sections", "walls", "regions", "toolpaths", "travels", "program")
        return "\n".join(["<Stages", *(f"  {name}: {getattr(self, name)!r}" for name in values), ">"])

    @property
    def drawable(self) -> object:
        """The moves, which a picture of the stages shows."""
        return self.program

    @property
    def plan(self) -> LayerPlan:
        """The layers of the part, without the layers of a raft."""
        return self.sections.plan
