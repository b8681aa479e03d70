"""A fixed amount of work of the kinds that slicing consists of, as a unit of CPU time.

CPU seconds differ between machines and between hours on a shared machine. Divided by the time of this work in the same
process, they can be compared.
"""

from __future__ import annotations

from time import process_time

import numpy as np

__all__ = ["calibration_seconds"]

_NUMBERS = 150_000
_SMALL_ARRAYS = 4_000
_OBJECTS = 60_000


def calibration_seconds() -> float:
    """Return the CPU time of work on large arrays, on many small arrays, and in a Python loop."""
    began = process_time()
    values = (np.arange(_NUMBERS, dtype=np.uint64) * np.uint64(2654435761) % np.uint64(2**32)).astype(
        np.float64
    )
    ascending = values[np.argsort(values, kind="stable")]
    place = np.searchsorted(ascending, values)
    np.bincount(place % 1000, weights=np.cumsum(np.hypot(ascending, values))[place])
    few = values[:40]
    for _ in range(_SMALL_ARRAYS):
        np.concatenate([few[few > 1e9], few.cumsum()]).reshape(-1, 1)
    found: dict[int, list[int]] = {}
    for number in range(_OBJECTS):
        found.setdefault(number * 7919 % 4093, []).append(number)
    return process_time() - began
