"""Meshes that are broken in ways that have names, made by script, and what their sections must be.

Each case is a mesh, where it is cut, and either the areas of the sections with a tolerance or a piece of the error that
refuses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from printer_slicer.geometry.planes import section_areas
from printer_slicer.model import Float, Mesh
from tests.parts import box, box_with_hole, joined, prism, sphere, sphere_area, without

__all__ = ["CASES", "Case", "ball", "turned_body"]


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


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.triangles[:, ::-1], mesh.name)


def with_facets(mesh: Mesh, *facets: Float) -> Mesh:
    return Mesh(
        np.concatenate([mesh.triangles, *(np.asarray(some, float).reshape(-1, 3, 3) for some in facets)])
    )


def flipped(mesh: Mesh, *facets: int) -> Mesh:
    triangles = mesh.triangles.copy()
    triangles[list(facets)] = triangles[list(facets), ::-1]
    return Mesh(triangles)


def wall(mesh: Mesh, axis: int, at: float) -> list[int]:
    """Facets that lie in a plane."""
    return np.flatnonzero((mesh.triangles[:, :, axis] == at).all(axis=1)).tolist()


def quad(*corners: tuple[float, float, float]) -> Float:
    a, b, c, d = (np.array(corner, float) for corner in corners)
    return np.array([[a, b, c], [a, c, d]])


def turned_body(mesh: Mesh, seed: int) -> Mesh:
    """Turned at random about all axes, standing on z = 0."""
    rng = np.random.default_rng(seed)
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    turn = q * np.sign(np.diag(r))
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    triangles = mesh.triangles @ turn.T
    return Mesh(triangles - [0, 0, triangles[:, :, 2].min()], mesh.name)


def ball(radius: float = 5.0, n: int = 24) -> Mesh:
    """A sphere of facets between parallels and meridians, pointed at both poles; its lowest point is at z = 0."""
    polar, turn = np.linspace(0, pi, n // 2 + 1), 2 * pi * np.arange(n + 1) / n
    turn[-1] = 0.0
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    corner = np.zeros((len(polar), n + 1, 3))
    corner[:, :, :2] = radius * np.sin(polar)[:, None, None] * ring
    corner[:, :, 2] = radius * (1 - np.cos(polar))[:, None]
    corner[[0, -1], :, :2] = 0.0
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    quads = np.concatenate(
        [
            np.stack([a, b, c], axis=2)[1:].reshape(-1, 3, 3),
            np.stack([a, c, d], axis=2)[:-1].reshape(-1, 3, 3),
        ]
    )
    return Mesh(quads, "ball")


def cracked_box(gap: float) -> Mesh:
    """A box of 10 mm in two halves that end openly, `gap` apart at x = 5."""
    half = without(box((5, 10, 10)), *wall(box((5, 10, 10)), 0, 5.0))
    other = without(box((5, 10, 10)), *wall(box((5, 10, 10)), 0, 0.0)).moved((5.0 + gap, 0, 0))
    return joined([half, other])


def cracked_ball(gap: float) -> Mesh:
    """A ball whose halves, left and right of x = 0, are drawn apart and end openly."""
    whole = ball()
    right = whole.triangles.mean(axis=1)[:, 0] > 0
    return joined([Mesh(whole.triangles[~right]), Mesh(whole.triangles[right]).moved((gap, 0, 0))])


def t_junction(extra: Float | tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """A box with an upright edge that is split on one side only, its middle moved by `extra`."""
    whole = box()
    facet = wall(whole, 0, 10.0)[0]
    a, b, c = whole.triangles[facet]
    middle = (a + c) / 2 + np.asarray(extra)
    return with_facets(without(whole, facet), [[a, b, middle], [b, c, middle]])


def bow_tie() -> Mesh:
    """A prism over an outline like an eight: a shell that crosses itself, one half inside out."""
    ring = np.array([(0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)])
    low, high = np.column_stack([ring, np.zeros(4)]), np.column_stack([ring, np.full(4, 10.0)])
    after_low, after_high = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
    walls = np.concatenate([np.stack([low, after_low, after_high], 1), np.stack([low, after_high, high], 1)])
    caps = [
        [low[0], low[2], low[1]],
        [low[0], low[3], low[2]],
        [high[0], high[1], high[2]],
        [high[0], high[2], high[3]],
    ]
    return with_facets(Mesh(walls), caps)


def moebius(n: int = 48) -> Mesh:
    """A strip with one side, standing up."""
    u = 2 * pi * np.arange(n + 1) / n
    half = 4.0
    rows = []
    for sign in (-1, 1):
        radius = 10 + sign * half * np.cos(u / 2)
        rows.append(np.stack([radius * np.cos(u), sign * half * np.sin(u / 2), radius * np.sin(u)], axis=1))
    low, high = rows
    low[-1], high[-1] = high[0], low[0]
    strip = np.concatenate(
        [np.stack([low[:-1], low[1:], high[1:]], 1), np.stack([low[:-1], high[1:], high[:-1]], 1)]
    )
    return Mesh(strip - [0, 0, strip[:, :, 2].min()])


def cup() -> Mesh:
    """A box without its top: one open sheet, no thickness."""
    return without(box(), *wall(box(), 2, 10.0))


def half_pipe(n: int = 24) -> Mesh:
    """Half a cylinder's wall, upright: a sheet."""
    turn = pi * np.arange(n + 1) / n
    ring = 10 * np.column_stack([np.cos(turn), np.sin(turn)])
    low, high = np.column_stack([ring, np.zeros(n + 1)]), np.column_stack([ring, np.full(n + 1, 10.0)])
    return Mesh(
        np.concatenate(
            [np.stack([low[:-1], low[1:], high[1:]], 1), np.stack([low[:-1], high[1:], high[:-1]], 1)]
        )
    )


def partition(x: float, *, double: bool) -> Mesh:
    """A box of 10 mm with a wall of no thickness across it, which shares its edges; of two facet layers if `double`."""
    ring = np.array([(0.0, 0), (x, 0), (10, 0), (10, 10), (x, 10), (0, 10)])
    low, high = np.column_stack([ring, np.zeros(6)]), np.column_stack([ring, np.full(6, 10.0)])
    after = np.roll(np.arange(6), -1)
    walls = np.concatenate(
        [np.stack([low, low[after], high[after]], 1), np.stack([low, high[after], high], 1)]
    )
    floor = np.concatenate([quad(*low[[0, 5, 4, 1]]), quad(*low[[1, 4, 3, 2]])])
    lid = np.concatenate([quad(*high[[0, 1, 4, 5]]), quad(*high[[1, 2, 3, 4]])])
    sheet = quad(low[1], low[4], high[4], high[1])
    return with_facets(Mesh(walls), floor, lid, sheet, *([sheet[:, ::-1]] if double else []))


def needles() -> Mesh:
    """A prism over an outline with corners a nanometre apart: facets like needles."""
    ring = [(0.0, 0.0), (5.0, 0.0), (5.000001, 0.0), (10.0, 0.0), (10.0, 10.0), (9.999999, 10.0), (0.0, 10.0)]
    return prism(ring, 10.0)


def folded(mesh: Mesh) -> Mesh:
    """With facets of no area: along an edge, and at a corner."""
    a, b = mesh.triangles[0, 0], mesh.triangles[0, 1]
    return with_facets(mesh, [[a, (a + b) / 2, b], [a, a, b], [a, a, a], [b, (a + b) / 2, a]])


def rough(mesh: Mesh, by: float, seed: int = 1) -> Mesh:
    """Every facet rounded on its own: no two share a corner."""
    return Mesh(mesh.triangles + np.random.default_rng(seed).uniform(-by, by, mesh.triangles.shape))


def many_holes(share: float, seed: int) -> Mesh:
    """A ball from which some facets are taken at random."""
    whole = ball()
    keep = np.random.default_rng(seed).random(whole.n_facets) >= share
    return Mesh(whole.triangles[keep])


def many_flips(share: float, seed: int) -> Mesh:
    whole = ball()
    return flipped(
        whole, *np.flatnonzero(np.random.default_rng(seed).random(whole.n_facets) < share).tolist()
    )


def soup() -> Mesh:
    """Facets anywhere."""
    rng = np.random.default_rng(3)
    middle = rng.uniform(0, 20, (400, 1, 3))
    return Mesh(middle + rng.uniform(-3, 3, (400, 3, 3)) + [0, 0, 3])


HALF: Final = tuple(100.0 for _ in MIDDLE)
BALL_CUTS: Final = (1.0, 3.3, 5.0, 7.9)


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
        "a void that is there twice, as its box": Case(
            joined([box(), box(), inside_out(inner), inside_out(inner)]),
            MIDDLE,
            (100, 84, 100),
            repairs=(DROPPED,),
        ),
        "a box that is there twice around a void": Case(
            joined([box(), box(), inside_out(inner)]), MIDDLE, (100, 84, 100), repairs=(DROPPED,)
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
        "an edge split on one side only": boxes(100, t_junction(), CRACKS),
        "an edge split beside its line": boxes(100, t_junction((0, 0.01, 0)), tolerance=0.06),
        "an edge split far beside its line": boxes(100, t_junction((0, 0.4, 0)), tolerance=2.1),
        "a crack of 0.0005 mm": boxes(100, cracked_box(0.0005), JOINED, tolerance=0.02),
        "a crack of 0.02 mm": boxes(100, cracked_box(0.02), JOINED, tolerance=0.3),
        "a crack of 0.9 mm": boxes(109, cracked_box(0.9), GAPS, tolerance=0.1),
        "a crack of 2 mm": boxes(100, cracked_box(2.0), FILLED),
        "a crack of 0.0005 mm around a ball": balls(cracked_ball(0.0005), tolerance=0.02),
        "a crack of 0.1 mm around a ball": balls(cracked_ball(0.1), GAPS, tolerance=1.1),
        "a wall of one facet across a box": boxes(100, partition(5.0, double=False), SHEETS),
        "a wall of one facet across a box near its end": boxes(100, partition(0.5, double=False), SHEETS),
        "a wall of two facets across a box": boxes(100, partition(4.0, double=True)),
        "a wall that shares no edge across a box": boxes(
            100, with_facets(box(), quad((5, 0, 0), (5, 10, 0), (5, 10, 10), (5, 0, 10)))
        ),
        "a fin of one facet at an edge": boxes(
            100, with_facets(box(), [[(10, 0, 0), (10, 0, 10), (15, -5, 5)]]), SHEETS
        ),
        "a loose facet": boxes(100, with_facets(box(), [[(15, 0, 0), (18, 0, 9), (15, 5, 5)]])),
        "a loose facet and its reverse": boxes(
            100,
            with_facets(box(), [[(15, 0, 0), (18, 0, 9), (15, 5, 5)], [(15, 5, 5), (18, 0, 9), (15, 0, 0)]]),
            DROPPED,
        ),
        "facets without area": boxes(100, folded(box())),
        "facets like needles": boxes(100, needles()),
        "a strip with one side": Case(moebius(), (5.0, 12.0), refused="one side only"),
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
