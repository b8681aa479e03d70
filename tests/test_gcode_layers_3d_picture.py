"""Extrusions drawn in 3D: where they are, which side is seen, and in which colour."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.drawing import draw_gcode_layers_3d
from printer_slicer.drawing.canvas import Raster, Text
from printer_slicer.drawing.gcode_layers_3d import _list_facets
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.layer_extrusions import LayerExtrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.rendering import Picture

FACETS = 18  # of a prism without its lower side


def extrusions(lines: Float, z: Float, purpose: int = Purpose.PERIMETER, height: float = 0.2) -> Extrusions:
    n = len(lines)
    begin, end = lines[:, 0], lines[:, 1]
    flat = np.zeros(n), np.full(n, height), np.full(n, 0.1), np.full(n, purpose), np.zeros(n)
    return Extrusions(begin, end, z, *flat)


def layers(beads: Extrusions, number: int = 3, count: int = 4) -> LayerExtrusions:
    return LayerExtrusions(
        number, count, 0.8, 0.2, beads, np.zeros(beads.n_beads), ("",), np.zeros((0, 2, 2))
    )


def seen(drawn: LayerExtrusions) -> Picture:
    picture = draw_gcode_layers_3d(drawn, "part", 200)
    return next(one for one in picture.shapes if isinstance(one, Raster)).pixels


@given(
    angle=st.floats(0, 6.3), length=st.floats(0.05, 30), height=st.floats(0.05, 0.3), shift=st.floats(-99, 99)
)
def test_facets_face_outward_around_each_extrusion(
    angle: float, length: float, height: float, shift: float
) -> None:
    way = length * np.array([np.cos(angle), np.sin(angle)])
    beads = extrusions(
        np.array([[(shift, 7.0), shift * np.array([1, 0]) + (0, 7) + way]]), np.ones(1), height=height
    )
    facets = _list_facets(beads, np.zeros((1, 3)))
    corners = facets.take(slice(0, facets.count))
    middle = np.append((beads.begin + beads.end)[0] / 2, 1 - height / 2)
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    low, high = corners.reshape(-1, 3).min(axis=0), corners.reshape(-1, 3).max(axis=0)
    side = np.array([-way[1], way[0]]) / length
    across = corners[..., :2] @ side

    assert facets.count == FACETS
    assert (((corners.mean(axis=1) - middle) * outward).sum(axis=1) > 0).all()
    assert (low[2], high[2]) == pytest.approx((1 - height, 1.0))
    assert np.ptp(across) == pytest.approx(float(beads.width[0]))


def test_facets_taken_by_number_are_those_of_the_whole() -> None:
    rng = np.random.default_rng(5)
    beads = extrusions(rng.uniform(0, 50, (40, 2, 2)), rng.uniform(1, 9, 40))
    facets = _list_facets(beads, np.zeros((40, 3)))
    whole = facets.take(slice(0, facets.count + 99))
    some = np.sort(rng.choice(facets.count, 25, replace=False))
    many = np.sort(rng.choice(facets.count, 500, replace=False))

    assert len(whole) == 40 * FACETS
    for which in (some, many):
        assert np.array_equal(facets.take(which), whole[which])
    assert len(facets.take(np.zeros(0, np.int64))) == 0


def test_what_lies_above_hides_what_lies_below() -> None:
    lines = np.array([[(0.0, y), (20.0, y)] for y in np.arange(0, 20, 0.4)])
    low = extrusions(lines, np.full(len(lines), 0.2), Purpose.INTERNAL_INFILL)
    top = extrusions(lines, np.full(len(lines), 0.4), Purpose.EXTERNAL_PERIMETER)
    both = Extrusions(
        *(np.concatenate([getattr(one, name) for one in (top, low)]) for name in Extrusions.__annotations__)
    )
    middle = seen(layers(both))[40:100, 60:140, :3].astype(int)
    covered, bare = (seen(layers(one))[40:100, 60:140, :3].astype(int) for one in (top, low))

    assert np.abs(middle.mean(axis=(0, 1)) - covered.mean(axis=(0, 1))).max() < 6
    assert np.abs(bare.mean(axis=(0, 1)) - covered.mean(axis=(0, 1))).max() > 40


def test_the_title_tells_how_many_layers_are_drawn() -> None:
    beads = extrusions(np.array([[(0.0, 0.0), (9.0, 0.0)]]), np.ones(1))
    some, every = (
        [
            one.text
            for one in draw_gcode_layers_3d(layers(beads, number), "part").shapes
            if isinstance(one, Text)
        ]
        for number in (1, 3)
    )

    assert some == ["part: layers 1 to 2 of 4, 0.8 mm high", "Perimeter"]
    assert every[0] == "part: 4 layers, 0.8 mm high"


def test_layers_without_extrusions_cannot_be_drawn() -> None:
    with pytest.raises(ValueError, match="nothing to draw"):
        draw_gcode_layers_3d(layers(extrusions(np.zeros((0, 2, 2)), np.zeros(0))), "part")
