"""Settings of printers, materials and qualities: definitions (`settings`), loading (`files`), checks (`checks`)."""

from printer_slicer.profile.files import (
    load_profile,
    profile_from,
    profile_over,
    profile_with,
    settings_of,
    settings_text,
)
from printer_slicer.profile.folders import profile_paths
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
    "load_profile",
    "profile_from",
    "profile_over",
    "profile_paths",
    "profile_with",
    "settings_of",
    "settings_text",
]
