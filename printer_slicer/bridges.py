"""The direction in which bridges rest on something at both ends."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import Areas, Bool, Float, Lines, hatch, intersection

__all__ = ["bridge_angles"]

_DIRECTIONS = 12
_NEAR = 1e-3  # mm: ends this close to a support lie on it; engines round to 0.01 µm


def bridge_angles(bridge: Areas, below: Areas, spacing: Float, usual: float) -> Float:
    """(L,) direction of each layer's bridge lines, radians.

    Tries directions 15° apart and takes the one with the largest share of length in lines that end on the layer
    below at both ends; of equals the one with the shortest lines. Layers without bridges, and bridges that nothing
    carries at both ends, get the usual direction.

    Args:
        bridge: areas over air, grown onto their supports.
        below: the section of the layer below each layer.
        spacing: (L,) mm between lines.
        usual: radians.
    """
    best = np.full(bridge.n_layers, usual)
    if bridge.n_rings == 0:
        return best
    support = intersection(bridge, below)
    record = np.zeros(bridge.n_layers)
    for angle in np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS:
        lines = hatch(bridge, angle=float(angle), spacing=spacing)
        carried = _carried(lines, hatch(support, angle=float(angle), spacing=spacing))
        total = np.bincount(lines.layer, weights=lines.length(), minlength=bridge.n_layers)
        held = np.bincount(lines.layer, weights=lines.length() * carried, minlength=bridge.n_layers)
        count = np.maximum(np.bincount(lines.layer, minlength=bridge.n_layers), 1)
        # A length of 1 m would weigh as much as a tenth of the share: it only decides between equals.
        score = np.where(held > 0, held / np.maximum(total, 1e-9) + 0.1 - 1e-4 * total / count, 0.0)
        best = np.where(score > record + 1e-9, angle, best)
        record = np.maximum(record, score)
    return best


def _carried(lines: Lines, support: Lines) -> Bool:
    """(S,) whether both ends of each line lie on a support line of the same row."""
    if support.n_lines == 0:
        return np.zeros(lines.n_lines, np.bool_)
    rows = np.concatenate([lines.row, support.row])
    row = rows - rows.min()
    group = np.concatenate([lines.layer, support.layer]) * (row.max() + 1) + row
    u = np.concatenate([lines.u, support.u])
    low, span = float(u.min()), float(u.max() - u.min()) + 1.0
    key = group[:, None] * span + (u - low)
    own, other = key[: lines.n_lines], key[lines.n_lines :]
    resting = np.ones(lines.n_lines, np.bool_)
    for end, inward in ((0, _NEAR), (1, -_NEAR)):
        at = own[:, end] + inward
        before = np.searchsorted(other[:, 0], at + _NEAR, side="right") - 1
        resting &= (before >= 0) & (other[np.maximum(before, 0), 1] >= at - _NEAR)
    return resting
