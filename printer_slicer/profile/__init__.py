"""The settings: what they are (`settings`), where they come from (`files`), what they mean together (`checks`)."""

from printer_slicer.profile.files import (
    DEFAULT_NAMES,
    KINDS,
    load_profile,
    part_settings,
    profile_paths,
    profile_with,
    settings_table,
    settings_text,
)
from printer_slicer.profile.settings import (
    AreaPlanner,
    Material,
    Planner,
    Printer,
    Profile,
    Quality,
    Speeds,
    UniformPlanner,
)

__all__ = [
    "DEFAULT_NAMES",
    "KINDS",
    "AreaPlanner",
    "Material",
    "Planner",
    "Printer",
    "Profile",
    "Quality",
    "Speeds",
    "UniformPlanner",
    "load_profile",
    "part_settings",
    "profile_paths",
    "profile_with",
    "settings_table",
    "settings_text",
]
