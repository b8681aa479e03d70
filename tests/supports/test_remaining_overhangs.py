"""The overhangs that other supports leave without support."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.geometry import Areas, difference, normalize
from printer_slicer.supports import remaining_overhangs
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.remaining_overhangs import find_remaining_overhangs
from printer_slicer.supports.support_paths import make_support_paths
from tests.supports.by_stages import prepared
from tests.supports.shapes import tub


def test_a_large_place_is_drawn_without_overlaps(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(tub())
    paths = make_support_paths(make_columns(overhangs, plan, sections, profile), profile)
    drawn = []

    def keep(areas: Areas) -> Areas:
        """Keep what is united."""
        drawn.append(areas)
        return normalize(areas)

    monkeypatch.setattr(remaining_overhangs, "normalize", keep)

    rest = find_remaining_overhangs(overhangs, paths.take(np.zeros(0, np.int64)), profile)

    assert difference(overhangs.area, rest.area).area().sum() < 0.01
    assert drawn[0].ring_area().sum() == pytest.approx(normalize(drawn[0]).area().sum(), rel=1e-3)
