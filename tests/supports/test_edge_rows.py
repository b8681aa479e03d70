"""Columns get more rows where the edge of an overhang is far from all others."""

from __future__ import annotations

import numpy as np

from printer_slicer.supports.bead_samples import sample_beads
from printer_slicer.supports.columns import make_columns
from printer_slicer.supports.edge_rows import add_edge_rows
from printer_slicer.supports.stability import check_stability
from printer_slicer.supports.styles import measure_path_volume
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.unsupported_beads import keep_samples
from printer_slicer.supports.unsupported_places import find_unsupported_groups
from tests.supports.by_stages import prepared
from tests.supports.shapes import tee


def test_a_row_is_added_below_an_edge_without_one() -> None:
    overhangs, plan, sections, profile = prepared(tee(), support="columns", support_interface_layers=0)
    supports = make_columns(overhangs, plan, sections, profile)
    paths = make_support_paths(supports, profile)
    samples = sample_beads(paths)
    y = samples.points(np.arange(samples.count))[:, 1]
    layer = paths.layer[samples.path]
    few = keep_samples(samples, paths, (y < overhangs.area.xy[:, 1].max() - 2.0) | (layer == 0))
    bare = find_unsupported_groups(overhangs, few, profile)

    more = add_edge_rows(supports, few, overhangs, profile)

    assert sum(one.area.sum() for one in bare) > 4.0
    assert find_unsupported_groups(overhangs, more, profile) == []
    assert measure_path_volume(more) < 1.2 * measure_path_volume(paths)
    standing = check_stability(supports, more, overhangs, sections, profile)
    assert measure_path_volume(standing.paths) > 0.98 * measure_path_volume(more)


def test_nothing_is_added_where_rows_are_near() -> None:
    overhangs, plan, sections, profile = prepared(tee(), support="columns")
    supports = make_columns(overhangs, plan, sections, profile)
    paths = make_support_paths(supports, profile)

    assert add_edge_rows(supports, paths, overhangs, profile) is paths
