"""Bodies for tests of mesh repair, and functions that damage them."""

from __future__ import annotations

from math import pi

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from tests.parts import box, joined, prism, without


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


def in_pieces(mesh: Mesh, gap: float) -> Mesh:
    """Every wall moved outward by `gap`: flat pieces that share no edge."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return Mesh(mesh.triangles + gap * normal[:, None], mesh.name)


def foam(n: int) -> Mesh:
    """A box with n³ voids of a tenth of a mm³ each, in a grid."""
    pitch = 10 / (n + 1)
    places = [(i, j, k) for i in range(n) for j in range(n) for k in range(n)]
    side = 0.5 * pitch
    voids = [
        inside_out(box((side,) * 3, tuple(0.75 * pitch + pitch * place for place in at))) for at in places
    ]
    return joined([box(), *voids])
