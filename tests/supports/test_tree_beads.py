"""The extrusions of trees: none begins in the air, and none sags."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from printer_slicer.model import Mesh, Sections, Toolpaths
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.trees import grow_trees
from tests.parts import plain
from tests.supports.by_hand import prepared
from tests.supports.free_beads import find_free_beads
from tests.supports.shapes import bracket, hook, sphere_on_bed, tee, tub

SHAPES: dict[str, Callable[[], Mesh]] = {
    "tee": tee,
    "hook": hook,
    "sphere": sphere_on_bed,
    "bracket": bracket,
    "tub": tub,
}


def lay(mesh: Mesh) -> tuple[Toolpaths, Sections]:
    overhangs, plan, sections = prepared(mesh)
    return make_support_paths(grow_trees(overhangs, plan, sections, plain()), plain()), sections


@pytest.mark.parametrize("name", SHAPES)
def test_no_bead_begins_in_the_air_or_sags(name: str) -> None:
    """Feet carry the loops on them, second loops begin on the bed, and branches stand close above the part."""
    paths, sections = lay(SHAPES[name]())

    assert len(np.unique(paths.layer)) > 10
    assert find_free_beads(paths, sections) == []
