"""Profiles of other slicers: read, converted, with an account of what was taken, approximated and left.

Names are imported when they are first used: who reads G-code of this program needs few of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.importing.importing import ImportRequest, import_profiles
    from printer_slicer.importing.report import Imported, ImportNote, Left, NoSettingsError, Refused, Taken
    from printer_slicer.importing.safety import Ceilings
    from printer_slicer.importing.writing import names_of_files, profile_text

__all__ = [
    "Ceilings",
    "ImportNote",
    "ImportRequest",
    "Imported",
    "Left",
    "NoSettingsError",
    "Refused",
    "Taken",
    "import_profiles",
    "names_of_files",
    "profile_text",
]

_HOMES: Final = {
    "Ceilings": "safety",
    "Imported": "report",
    "Left": "report",
    "NoSettingsError": "report",
    "ImportNote": "report",
    "Refused": "report",
    "Taken": "report",
    "ImportRequest": "importing",
    "import_profiles": "importing",
    "names_of_files": "writing",
    "profile_text": "writing",
}


__getattr__ = lazy_names(__name__, _HOMES)
