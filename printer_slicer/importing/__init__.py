"""Profiles of other slicers: read, converted, with an account of what was taken, approximated and left.

Names are imported when they are first used: who reads G-code of this program needs few of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.lazy_names import lazy_names

if TYPE_CHECKING:
    from printer_slicer.importing.embedded import NoSettingsError
    from printer_slicer.importing.importing import Wanted, import_profiles
    from printer_slicer.importing.report import Imported, Left, Note, Refused, Taken
    from printer_slicer.importing.safety import Ceilings
    from printer_slicer.importing.writing import names_of_files, profile_text

__all__ = [
    "Ceilings",
    "Imported",
    "Left",
    "NoSettingsError",
    "Note",
    "Refused",
    "Taken",
    "Wanted",
    "import_profiles",
    "names_of_files",
    "profile_text",
]

_HOMES: Final = {
    "Ceilings": "safety",
    "Imported": "report",
    "Left": "report",
    "NoSettingsError": "embedded",
    "Note": "report",
    "Refused": "report",
    "Taken": "report",
    "Wanted": "importing",
    "import_profiles": "importing",
    "names_of_files": "writing",
    "profile_text": "writing",
}


__getattr__ = lazy_names(__name__, _HOMES)
