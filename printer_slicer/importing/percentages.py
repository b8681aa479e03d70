"""Settings of other slicers that take percentages.

Source: the setting definitions of PrusaSlicer 2.5 and OrcaSlicer (coPercent, coFloatOrPercent).
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["takes_percentage"]

_ALL: Final = re.compile(
    r"fill_density|infill_overlap|infill_anchor(_max)?|min_bead_width|min_feature_size|ironing_flowrate"
    r"|raft_first_layer_density|retract_before_wipe|avoid_crossing_perimeters_max_detour|first_layer_height"
    r"|(\w+_)?extrusion_width|overhang_speed_\d|small_perimeter_speed"
    # ratios: a percentage can mean only one value
    r"|extrusion_multiplier|bridge_flow_ratio|\w+_fan_speed|overhang_fan_speed_\d"
)
_PRUSASLICER: Final = re.compile(
    r"external_perimeter_speed|(top_)?solid_infill_speed|first_layer(_infill)?_speed"
    r"|support_material_interface_speed|support_material_xy_spacing"
)
_ORCA: Final = re.compile(
    r"solid_infill_overlap|seam_slope_start_height|overhang_fan_threshold|bridge_speed_internal|first_layer_travel_speed"
    r"|bridge_acceleration|(solid_)?infill_acceleration"
)


def takes_percentage(name: str, dialect: str) -> bool:
    """Return whether the other slicer accepts a percentage as the value of a setting.

    Args:
        name: PrusaSlicer's name of the setting.
        dialect: as in `Preset`; Cura's percentages are checked where they are translated.
    """
    own = _ORCA if dialect == "orca" else _PRUSASLICER
    return dialect == "cura" or bool(_ALL.fullmatch(name) or own.fullmatch(name))
