"""Settings of printers, materials and qualities: definitions (`settings`), loading (`files`), checks (`checks`)."""

from printer_slicer.profile.files import (
    complete_profile,
    list_settings,
    load_profile,
    profile_with,
    restore_profile,
    settings_as_dict,
)
from printer_slicer.profile.folders import find_profile_paths
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import DEFAULT_NAMES, KINDS
from printer_slicer.profile.settings import (
    Accelerations,
    AreaPlanner,
    CuspPlanner,
    GeneticPlanner,
    HeightRange,
    Material,
    OptimalPlanner,
    Planner,
    Printer,
    Quality,
    Speeds,
    StepwisePlanner,
    UniformPlanner,
)

__all__ = [
    "DEFAULT_NAMES",
    "KINDS",
    "Accelerations",
    "AreaPlanner",
    "CuspPlanner",
    "GeneticPlanner",
    "HeightRange",
    "Material",
    "OptimalPlanner",
    "Planner",
    "Printer",
    "Profile",
    "Quality",
    "Speeds",
    "StepwisePlanner",
    "UniformPlanner",
    "complete_profile",
    "find_profile_paths",
    "list_settings",
    "load_profile",
    "profile_with",
    "restore_profile",
    "settings_as_dict",
]
