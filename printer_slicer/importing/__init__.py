"""Profiles of other slicers: read, converted, with an account of what was taken, approximated and left."""

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
