"""Plastic per second, where single moves are too short to tell."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float

__all__ = ["ENOUGH", "flow_of"]

ENOUGH = 0.2
"""mm³; the rounding of E in less of it says more than the flow."""

_DUST = 1e-7  # mm³, of sums


def flow_of(volume: Float, seconds: Float) -> Float:
    """(n,) mm³/s of moves that lay plastic one after the other: of each with as many before it as lay 0.2 mm³.

    A curve is many short moves; together they are as fast as a long one. 0 where so much has not been laid yet.

    Args:
        volume: (n,) mm³ of each, above 0.
        seconds: (n,) that each takes.
    """
    if not len(volume):
        return np.zeros(0)
    laid, spent = np.cumsum(volume), np.cumsum(seconds)
    # The last move from which on enough is laid up to each.
    begin = np.searchsorted(laid - volume, laid - ENOUGH + _DUST, side="right") - 1
    enough = laid >= ENOUGH - _DUST
    begin = np.maximum(begin, 0)
    pushed, took = laid - (laid - volume)[begin], spent - (spent - seconds)[begin]
    return np.asarray(np.where(enough & (took > 0), pushed / np.maximum(took, 1e-9), 0.0))
