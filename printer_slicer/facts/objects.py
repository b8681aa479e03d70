"""Present the print time and the filament of each object on a plate, as facts for JSON and as sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.profile import Profile
from printer_slicer.stages import Stages
from printer_slicer.texts import format_duration, format_significant

__all__ = ["collect_object_facts", "format_object_sentences"]

_MAX_SHOWN = 6  # objects in a sentence


def collect_object_facts(stages: Stages, profile: Profile, seconds: Float) -> list[dict[str, Any]]:
    """Return time and filament of each object, with its supports, for JSON; empty for a single object.

    The rest of the print, such as travels, skirt, brim and raft, belongs to no object.

    Args:
        stages: the sliced plate.
        profile: the profile used for slicing.
        seconds: (K,) estimated time of each move.
    """
    labels, program = stages.labels, stages.program
    if labels is None:
        return []
    grams_per_mm = profile.material.filament_area / 1000 * profile.material.density
    count = len(labels.names)
    own = labels.object_id >= 0
    time, length = (
        np.bincount(labels.object_id[own], amounts[own], minlength=count).tolist()
        for amounts in (seconds, program.filament)
    )
    return [
        {
            "name": name,
            "seconds": round(time[at], 3),
            "filament_mm": round(length[at], 3),
            "filament_g": round(length[at] * grams_per_mm, 3),
        }
        for at, name in enumerate(labels.names)
    ]


def format_object_sentences(objects: Sequence[dict[str, Any]]) -> list[str]:
    """Format time and filament of the first objects as one sentence; empty without objects."""
    if not objects:
        return []
    shown = [
        f"{one['name']} {format_duration(one['seconds'])}, {format_significant(one['filament_g'])} g"
        for one in objects[:_MAX_SHOWN]
    ]
    more = (
        [f"{len(objects) - _MAX_SHOWN} more (the JSON output lists all)"] if len(objects) > _MAX_SHOWN else []
    )
    return [f"Objects: {'; '.join([*shown, *more])}"]
