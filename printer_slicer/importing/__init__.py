"""Convert profiles of other slicers, and report how each setting was converted.

Names are imported when they are first used, because reading G-code of this program needs only few of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.importing.differences import Difference, find_largest_differences, find_other_notes
    from printer_slicer.importing.importing import ImportRequest, import_profiles
    from printer_slicer.importing.profile_files import choose_file_names, format_profile, make_short_name
    from printer_slicer.importing.results import (
        ConvertedSetting,
        ImportedProfile,
        ImportNote,
        NoSettingsError,
        RejectedProfile,
        UnsupportedSetting,
    )
    from printer_slicer.importing.safety_checks import TemperatureLimits

__all__ = [
    "ConvertedSetting",
    "Difference",
    "ImportNote",
    "ImportRequest",
    "ImportedProfile",
    "NoSettingsError",
    "RejectedProfile",
    "TemperatureLimits",
    "UnsupportedSetting",
    "choose_file_names",
    "find_largest_differences",
    "find_other_notes",
    "format_profile",
    "import_profiles",
    "make_short_name",
]

_HOMES: Final = {
    "TemperatureLimits": "safety_checks",
    "ImportedProfile": "results",
    "UnsupportedSetting": "results",
    "NoSettingsError": "results",
    "ImportNote": "results",
    "RejectedProfile": "results",
    "ConvertedSetting": "results",
    "ImportRequest": "importing",
    "import_profiles": "importing",
    "choose_file_names": "profile_files",
    "format_profile": "profile_files",
    "make_short_name": "profile_files",
    "Difference": "differences",
    "find_largest_differences": "differences",
    "find_other_notes": "differences",
}


__getattr__ = lazy_names(__name__, _HOMES)
