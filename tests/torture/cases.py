"""Meshes that are broken in ways that have names, made by script, and what their sections must be.

Each case is a mesh, where it is cut, and either the areas of the sections with a tolerance or a piece of the error that
refuses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.model import Mesh
from tests.parts import box, box_with_hole, joined, sphere, sphere_area, without
from tests.torture.bodies import (
    ball,
    bow_tie,
    cracked_ball,
    cracked_box,
    cup,
    flipped,
    foam,
    folded,
    half_pipe,
    in_pieces,
    inside_out,
    many_flips,
    many_holes,
    moebius,
    needles,
    partition,
    quad,
    rough,
    soup,
    t_junction,
    wall,
    with_facets,
)

__all__ = ["CASES", "Case"]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """One torture.

    Attributes:
        mesh: the broken mesh.
        cuts: z of the planes, mm.
        areas: mm² at each plane; empty where the mesh is refused.
        tolerance: mm² at each plane.
        refused: what the error must say; empty where the mesh is sliced.
        repairs: kinds of repairs that must be told.
    """

    mesh: Mesh
    cuts: tuple[float, ...]
    areas: tuple[float, ...] = ()
    tolerance: float = 1e-3
    refused: str = ""
    repairs: tuple[str, ...] = ()


MIDDLE: Final = (1.3, 5.0, 8.7)
DROPPED, SHEETS, TURNED = (
    "duplicate facets dropped",
    "sheets without thickness dropped",
    "facets turned round",
)
SHELLS, FILLED, CRACKS = "shells turned outward", "holes filled", "cracks closed along edges"
JOINED, GAPS, INSIDE_OUT = "corners joined", "gaps in contours closed", "inside-out areas left out"
VOIDS, LOOSE = "voids turned inward", "loose facets dropped"


BALL_CUTS: Final = (1.0, 3.3, 5.0, 7.9)
HALF: Final = tuple(100.0 for _ in MIDDLE)


def ball_areas(radius: float = 5.0, n: int = 24, cuts: tuple[float, ...] = BALL_CUTS) -> tuple[float, ...]:
    """Sections of the ball as it was before it was broken, from its facets alone."""
    return tuple(section_areas(ball(radius, n).triangles, np.array(cuts)).tolist())


def boxes(areas: float, mesh: Mesh, *repairs: str, tolerance: float = 1e-3) -> Case:
    return Case(mesh, MIDDLE, (areas,) * 3, tolerance, repairs=repairs)


def balls(mesh: Mesh, *repairs: str, tolerance: float) -> Case:
    return Case(mesh, BALL_CUTS, ball_areas(), tolerance, repairs=repairs)


def _cases() -> Mapping[str, Case]:
    inner = box((4, 4, 4), (3, 3, 3))
    hole = box_with_hole((10, 10, 10), (4, 4))
    shared = quad((0, 0, 0), (0, 0, 10), (0, 10, 10), (0, 10, 0))
    return {
        "two boxes that overlap": boxes(175, joined([box(), box(at=(5, 5, 0))])),
        "two boxes in one place": boxes(100, joined([box(), box()])),
        "two boxes side to side": boxes(200, joined([box(), box(at=(10, 0, 0))])),
        "two boxes side to side with different diagonals": boxes(
            200, joined([box(), Mesh(box().triangles[:, :, [1, 0, 2]][:, ::-1]).moved((10, 0, 0))])
        ),
        "two boxes that share an edge": boxes(200, joined([box(), box(at=(10, 10, 0))])),
        "two boxes that share an edge, one inside out": boxes(
            200, joined([box(), inside_out(box(at=(10, 10, 0)))]), SHELLS
        ),
        "a box in a box": boxes(100, joined([box(), inner])),
        "a box that shares a side with one around it": boxes(100, joined([box(), box((4, 10, 10))])),
        "a void": Case(joined([box(), inside_out(inner)]), MIDDLE, (100, 84, 100)),
        "a box in a void": Case(
            joined([box(), inside_out(inner), box((2, 2, 2), (4, 4, 4))]), MIDDLE, (100, 88, 100)
        ),
        "a void in a box in a void": Case(
            joined(
                [
                    box(),
                    inside_out(inner),
                    box((2, 2, 2), (4, 4, 4)),
                    inside_out(box((1, 1, 1), (4.5, 4.5, 4.5))),
                ]
            ),
            MIDDLE,
            (100, 87, 100),
        ),
        "a void that is defined twice, as its box": Case(
            joined([box(), box(), inside_out(inner), inside_out(inner)]),
            MIDDLE,
            (100, 84, 100),
            repairs=(DROPPED,),
        ),
        "a box that is defined twice around a void": Case(
            joined([box(), box(), inside_out(inner)]), MIDDLE, (100, 84, 100), repairs=(DROPPED,)
        ),
        "a box with a void, all inside out": Case(
            inside_out(joined([box(), inside_out(inner)])), MIDDLE, (100, 84, 100), repairs=(SHELLS, VOIDS)
        ),
        "a box with a void, mirrored": Case(
            Mesh(joined([box(), inside_out(inner)]).triangles * [-1, 1, 1]),
            MIDDLE,
            (100, 84, 100),
            repairs=(SHELLS, VOIDS),
        ),
        "a box with a void, all inside out, beside one that is not": Case(
            joined([box(at=(20, 0, 0)), inside_out(joined([box(), inside_out(inner)]))]),
            MIDDLE,
            (200, 184, 200),
            repairs=(SHELLS, VOIDS),
        ),
        "a void in a box in a void, all inside out": Case(
            inside_out(
                joined(
                    [
                        box(),
                        inside_out(inner),
                        box((2, 2, 2), (4, 4, 4)),
                        inside_out(box((1, 1, 1), (4.5, 4.5, 4.5))),
                    ]
                )
            ),
            MIDDLE,
            (100, 87, 100),
            repairs=(SHELLS, VOIDS),
        ),
        "only the outside of a box with a void inside out": Case(
            joined([inside_out(box()), inside_out(inner)]), MIDDLE, (100, 84, 100), repairs=(SHELLS,)
        ),
        "hundreds of voids": Case(foam(7), (5.0,), (100 - 49 * 0.625**2,)),
        "hundreds of voids, all inside out": Case(
            inside_out(foam(7)), (5.0,), (100 - 49 * 0.625**2,), repairs=(SHELLS, VOIDS)
        ),
        "a shell inside out beside another": boxes(
            200, joined([box(), inside_out(box(at=(20, 0, 0)))]), SHELLS
        ),
        "three shells, two of them inside out": boxes(
            300, joined([inside_out(box()), box(at=(20, 0, 0)), inside_out(box(at=(40, 0, 0)))]), SHELLS
        ),
        "a shell inside out that overlaps another": Case(
            joined([box(), inside_out(box((10, 10, 10), (5, 5, 0)))]), MIDDLE, (175,) * 3, repairs=(SHELLS,)
        ),
        "a shell that crosses itself": boxes(25, bow_tie(), INSIDE_OUT),
        "one facet the wrong way": boxes(100, flipped(box(), 5), TURNED),
        "four facets the wrong way": Case(flipped(hole, 0, 5, 9, 17), MIDDLE, (84,) * 3, repairs=(TURNED,)),
        "a fifth of the facets the wrong way": balls(many_flips(0.2, 5), TURNED, tolerance=1e-3),
        "every second facet the wrong way": balls(
            flipped(ball(), *range(0, ball().n_facets, 2)), TURNED, tolerance=1e-3
        ),
        "one facet twice": boxes(100, with_facets(box(), box().triangles[4]), DROPPED),
        "one facet three times": boxes(100, with_facets(box(), box().triangles[[4, 4]]), DROPPED),
        "one facet twice, the second reversed": boxes(
            100, with_facets(box(), box().triangles[4, ::-1]), DROPPED
        ),
        "all facets twice": boxes(100, with_facets(box(), box().triangles)),
        "all facets twice, the second time reversed": boxes(
            100, with_facets(box(), box().triangles[:, ::-1]), DROPPED
        ),
        "one wall twice": boxes(100, with_facets(box(), box().triangles[wall(box(), 0, 10.0)]), DROPPED),
        "one wall twice, the second reversed": boxes(
            100, with_facets(box(), box().triangles[wall(box(), 0, 10.0), ::-1]), DROPPED
        ),
        "one facet of a wall missing": boxes(100, without(box(), wall(box(), 0, 10.0)[0]), FILLED),
        "one side missing": boxes(100, without(box(), *wall(box(), 0, 10.0)), FILLED),
        "two opposite sides missing": boxes(
            100, without(box(), *wall(box(), 0, 10.0), *wall(box(), 0, 0.0)), FILLED
        ),
        "no bottom": boxes(100, without(box(), *wall(box(), 2, 0.0)), FILLED),
        "neither top nor bottom": boxes(
            100, without(box(), *wall(box(), 2, 0.0), *wall(box(), 2, 10.0)), FILLED
        ),
        "one facet of a ball missing": balls(without(ball(), 200), FILLED, tolerance=1e-3),
        "two facets of a ball missing side by side": balls(
            without(ball(), 6 * 24 + 3, 6 * 24 + 3 + (ball().n_facets // 2)), FILLED, tolerance=0.5
        ),
        "a twentieth of a ball missing": balls(many_holes(0.05, 2), FILLED, tolerance=1.0),
        "a cap of a ball missing": Case(
            Mesh(ball().triangles[ball().triangles[:, :, 0].max(axis=1) < 4.5]),
            (5.0,),
            ball_areas(cuts=(5.0,)),
            3.0,
        ),
        "an edge split on one-sided": boxes(100, t_junction(), CRACKS),
        "an edge split beside its line": boxes(100, t_junction((0, 0.01, 0)), tolerance=0.06),
        "an edge split far beside its line": boxes(100, t_junction((0, 0.4, 0)), tolerance=2.1),
        "a crack of 0.0005 mm": boxes(100, cracked_box(0.0005), JOINED, tolerance=0.02),
        "a crack of 0.02 mm": boxes(100, cracked_box(0.02), JOINED, tolerance=0.3),
        "a crack of 0.9 mm": boxes(109, cracked_box(0.9), GAPS, tolerance=0.1),
        "a crack of 2 mm": boxes(100, cracked_box(2.0), FILLED),
        "a crack of 0.0005 mm around a ball": balls(cracked_ball(0.0005), tolerance=0.02),
        "a crack of 0.1 mm around a ball": balls(cracked_ball(0.1), GAPS, tolerance=1.1),
        "a crack of 0.1 mm around a ball, all inside out": balls(
            inside_out(cracked_ball(0.1)), SHELLS, GAPS, tolerance=1.1
        ),
        "six walls that share no edge": boxes(116.32, in_pieces(box(), 0.4), tolerance=0.1),
        "six walls that share no edge, all inside out": boxes(
            116.32, inside_out(in_pieces(box(), 0.4)), SHELLS, tolerance=0.1
        ),
        "six walls that share no edge beside a box": boxes(
            1116.32,
            joined([in_pieces(box(), 0.4), box((40, 25, 10), (20, 0, 0))]),
            tolerance=0.1,
        ),
        "a wall of one facet across a box": boxes(100, partition(5.0, double=False), SHEETS),
        "a wall of one facet across a box near its end": boxes(100, partition(0.5, double=False), SHEETS),
        "a wall of two facets across a box": boxes(100, partition(4.0, double=True)),
        "a wall that shares no edge across a box": boxes(
            100, with_facets(box(), quad((5, 0, 0), (5, 10, 0), (5, 10, 10), (5, 0, 10)))
        ),
        "a fin of one facet at an edge": boxes(
            100, with_facets(box(), [[(10, 0, 0), (10, 0, 10), (15, -5, 5)]]), SHEETS
        ),
        "a loose facet": boxes(100, with_facets(box(), [[(15, 0, 0), (18, 0, 9), (15, 5, 5)]]), LOOSE),
        "a loose facet through a wall": boxes(
            100, with_facets(box(), [[(5, 5, 0.5), (15, 5, 5), (12, 8, 9.5)]]), LOOSE
        ),
        "three loose facets through walls and each other": boxes(
            100,
            with_facets(
                box(),
                [(5, 5, 0.5), (15, 5, 5), (12, 8, 9.5)],
                [(3, 9, 1), (14, 2, 6), (14, 9, 9)],
                [(-4, 4, 0.5), (20, 6, 2), (3, 4, 9.5)],
            ),
            LOOSE,
        ),
        "a loose facet and its reverse": boxes(
            100,
            with_facets(box(), [[(15, 0, 0), (18, 0, 9), (15, 5, 5)], [(15, 5, 5), (18, 0, 9), (15, 0, 0)]]),
            DROPPED,
        ),
        "facets without area": boxes(100, folded(box())),
        "facets like needles": boxes(100, needles()),
        "a strip with one side": Case(moebius(), (5.0, 12.0), refused="one-sided"),
        "a cup of one sheet": boxes(100, cup(), FILLED),
        "half a pipe of one sheet": Case(half_pipe(), (5.0,), refused="surface is open"),
        "one upright sheet": Case(
            Mesh(quad((0, 0, 0), (10, 0, 0), (10, 0.1, 10), (0, 0, 10))),
            (5.0,),
            refused="open|no volume|no layer",
        ),
        "facets anywhere": Case(
            soup(), (5.0, 10.0, 15.0), refused="surface is open|no layer contains any material"
        ),
        "every facet rounded on its own": Case(
            rough(ball(), 2e-4), BALL_CUTS, ball_areas(), 0.05, repairs=(JOINED,)
        ),
        "every facet moved a little": Case(rough(ball(), 0.01), BALL_CUTS, ball_areas(), 1.0),
        "planes through corners": Case(
            sphere(10),
            tuple(np.unique(sphere(10).triangles[:, :, 2])[1:-1].tolist()),
            tuple(sphere_area(z) for z in np.unique(sphere(10).triangles[:, :, 2])[1:-1]),
        ),
        "a box at 100 m": Case(box().moved((1e5, -1e5, 0)), MIDDLE, HALF, 1e-3),
        "a box at 100 m in 32-bit numbers, each facet rounded on its own": Case(
            Mesh(rough(box().moved((1e5, -1e5, 0)), 0.004).triangles.astype(np.float32).astype(float)),
            MIDDLE,
            HALF,
            0.5,
        ),
        "a side of no facets but shared corners": boxes(
            100, with_facets(without(box(), *wall(box(), 0, 0.0)), shared[:1, ::1])
        ),
    }


CASES: Final[Mapping[str, Case]] = _cases()
"""Name -> torture."""
