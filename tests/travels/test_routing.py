"""The shortest ways, against others that find them: networkx in graphs, and every corner of a polygon tried."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import networkx as nx
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.model import Sections
from printer_slicer.travels import travel
from printer_slicer.travels.graphs import RouteQueries
from printer_slicer.travels.inset_regions import build_inset_regions
from printer_slicer.travels.routes import build_routes, straight_routes
from printer_slicer.travels.routing import find_routes
from printer_slicer.travels.shortest_paths import GraphEdges, find_shortest_paths
from tests.parts import layers, profile, shape, shapely
from tests.strategies import clean_areas
from tests.travels.places import length_of, places, way

seeds = st.integers(0, 2**32 - 1)
BOX = np.full(2, -50.0), np.full(2, 50.0)


# --- graphs ---


@given(seed=seeds)
def test_the_shortest_ways_through_graphs_are_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n_graphs, n_nodes = 5, 8
    graphs, parts = [], []
    for first in range(0, n_graphs * n_nodes, n_nodes):
        count = int(rng.integers(0, 25))
        tail, head = first + rng.integers(0, n_nodes, (2, count))
        length = rng.choice([1.0, 2.0, 2.5, 7.0, np.inf], count)
        parts.append(GraphEdges(tail, head, length))
        graph = nx.DiGraph()
        graph.add_nodes_from(range(first, first + n_nodes))
        for a, b, mm in zip(tail.tolist(), head.tolist(), length.tolist(), strict=True):
            if np.isfinite(mm) and mm < graph.get_edge_data(a, b, {"mm": np.inf})["mm"]:
                graph.add_edge(a, b, mm=mm)
        graphs.append(graph)
    begin = np.arange(n_graphs) * n_nodes
    length, nodes, count = find_shortest_paths(GraphEdges.joined(parts), begin, begin + 1, n_graphs * n_nodes)

    passed = np.split(nodes, np.cumsum(count)[:-1])
    for graph, a, mm, between in zip(graphs, begin.tolist(), length.tolist(), passed, strict=True):
        try:
            wanted = nx.dijkstra_path_length(graph, a, a + 1, weight="mm")
        except nx.NetworkXNoPath:
            assert mm == np.inf
            assert not len(between)
        else:
            assert mm == wanted
            assert nx.path_weight(graph, [a, *between.tolist(), a + 1], "mm") == wanted


# --- polygons ---


def brute(area: Any, begin: Float, end: Float) -> float:
    """Length of the shortest way in an area: every leg between all of its corners is tried."""
    wide = area.buffer(1e-6)
    corners = [begin, end, *shapely.get_coordinates(area)]
    graph = nx.Graph()
    graph.add_nodes_from((0, 1))
    for (i, a), (j, b) in combinations(enumerate(corners), 2):
        leg = shapely.LineString([a, b])
        if wide.contains(leg):
            graph.add_edge(i, j, mm=leg.length)
    try:
        return float(nx.dijkstra_path_length(graph, 0, 1, weight="mm"))
    except nx.NetworkXNoPath:
        return np.inf


def within(areas: Areas, seed: int, count: int) -> Float:
    """Points (P, 2) inside, a little off the outlines."""
    rng = np.random.default_rng(seed)
    area = shape(areas, 0).buffer(-0.15)
    points = rng.uniform(-20, 20, (400, 2))
    points = points[shapely.contains_xy(area, points)]
    assume(len(points) >= count)
    return np.asarray(points[:count], np.float64)


@given(areas=clean_areas(1), seed=seeds)
def test_ways_in_rooms_are_the_shortest(areas: Areas, seed: int) -> None:
    points = within(areas, seed, 6)
    rooms = build_inset_regions(areas, BOX, 0.1)
    pairs = np.array(list(combinations(range(6), 2)))
    layer = np.zeros(len(pairs), np.int64)
    (begin, room), (end, other) = (rooms.locate(points[side], layer) for side in pairs.T)
    same = np.flatnonzero((room == other) & (room >= 0))
    asked = RouteQueries(
        begin[same], end[same], layer[same], room[same], np.full(len(same), np.inf), np.zeros(len(same))
    )
    found = find_routes(asked, rooms.field)

    assert found.is_found.all()
    tight, _ = build_routes(
        straight_routes(begin[same], end[same], layer[same]),
        (begin[same], end[same]),
        found,
        rooms.field.corners,
    )
    area = shape(rooms.field.areas, 0)
    for one, mm, a, b in zip(same.tolist(), tight.length().tolist(), begin[same], end[same], strict=True):
        wanted = brute(area, a, b)
        assert mm == pytest.approx(wanted, rel=2e-3, abs=0.02), one
    for one in set(range(len(pairs))) - set(same.tolist()):
        assert brute(area, begin[one], end[one]) == np.inf


@given(areas=clean_areas(1), seed=seeds)
def test_ways_are_hardly_longer_than_the_shortest_inside(areas: Areas, seed: int) -> None:
    """They keep away from the outlines, which costs something at every corner."""
    points = within(areas, seed, 5)
    sections = Sections(layers(1, 0.2), areas)
    paths = places(sections, points)
    travels = travel(paths, sections, profile(max_detour=1000))
    area = shape(areas, 0)
    for index in range(1, paths.n_paths):
        line = way(paths, travels, index)
        wanted = brute(area, *line[[0, -1]])
        if travels.crossings[index] == 0:
            corners = len(line) - 2
            assert wanted - 1e-6 <= length_of(line) <= 1.05 * wanted + 1.0 * corners
        elif wanted < np.inf:  # only where there is no room for a nozzle's way
            assert brute(area.buffer(-0.2), *line[[0, -1]]) == np.inf


def test_many_corners_around_a_round_hole() -> None:
    disc, hole = shapely.Point(0, 0).buffer(30, quad_segs=64), shapely.Point(0, 0).buffer(20, quad_segs=64)
    ring = shapely.difference(disc, hole)
    rings = [shapely.get_coordinates(one)[:-1] for one in (ring.exterior, *ring.interiors)]
    areas = Areas.from_rings([[rings[0][::-1], rings[1][::-1]]])
    assert areas.area()[0] > 0
    sections = Sections(layers(1, 0.2), areas)
    paths = places(sections, [(-25, 0.5), (25, 0.5)])
    travels = travel(paths, sections, profile(max_detour=1000))

    # Two tangents of 15 mm and the arc between them, over the hole and not under it.
    line = way(paths, travels, 1)
    assert travels.crossings[1] == 0
    assert line[1:-1, 1].min() > 0
    tangent = np.arccos(20 / 25)
    assert length_of(line) == pytest.approx(30 + 20 * (np.pi - 2 * tangent), rel=0.03)


def test_ways_between_many_holes_are_found() -> None:
    """A grille: the straight ways cross up to a dozen holes."""
    rings = [np.array([(0, 0), (36, 0), (36, 36), (0, 36)], float)]
    around = np.linspace(0, -2 * np.pi, 16, endpoint=False)
    hole = np.stack([np.cos(around), np.sin(around)], axis=1)
    rings += [hole + np.array([3 * i + 1.5, 3 * j + 1.5]) for i in range(12) for j in range(12)]
    sections = Sections(layers(1, 0.2), Areas.from_rings([rings]))
    points = np.random.default_rng(0).uniform(0.3, 35.7, (80, 2))
    points = points[shapely.contains_xy(shape(sections.solid, 0).buffer(-0.15), points)]
    paths = places(sections, points)

    assert len(points) > 30
    travels = travel(paths, sections, profile())

    assert not travels.crossings.any()
    for index in range(1, paths.n_paths):
        line = way(paths, travels, index)
        assert length_of(line) <= 1.15 * length_of(line[[0, -1]]) + 1.5


def test_a_maze_is_solved() -> None:
    """Walls that leave a gap on alternate sides: 20 turns."""
    walls = [shapely.box(0 if k % 2 else 5, 4 * k + 3, 35 if k % 2 else 40, 4 * k + 4) for k in range(20)]
    area = shapely.box(0, 0, 40, 84).difference(shapely.union_all(walls))
    rings = [shapely.get_coordinates(one)[:-1] for one in (area.exterior, *area.interiors)]
    areas = Areas.from_rings([rings if shapely.is_ccw(area.exterior) else [one[::-1] for one in rings]])
    sections = Sections(layers(1, 0.2), areas)
    paths = places(sections, [(20, 1), (20, 83)])
    travels = travel(paths, sections, profile(max_detour=2000))

    assert travels.crossings[1] == 0
    line = way(paths, travels, 1)
    assert len(line) >= 22
    assert length_of(line) == pytest.approx(brute(area, *line[[0, -1]]), rel=0.05)
