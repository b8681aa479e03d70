"""Read the settings in G-code files of this program and of other slicers, or the machine that they name."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.profile.files import FileSettings
from printer_slicer.profile.finding import find_profile_by_display_name

__all__ = ["read_gcode_settings"]

_SEARCHED_BYTES: Final = 1 << 14  # at both ends of a file, where slicers name the machine
_MACHINE: Final = re.compile(
    rb"^; ?(?:TARGET_MACHINE\.NAME:|machine_type:|printer_model = |printer_settings_id = )([^\r\n]{1,100})",
    re.MULTILINE,
)


def read_gcode_settings(path: Path, folders: Sequence[Path] = ()) -> FileSettings:
    """Read the settings in a G-code file that this program, PrusaSlicer or its forks wrote, or the machine it names.

    Settings that an import would reject, such as impossible temperatures, are not used.

    Args:
        path: the G-code file.
        folders: further folders of profiles.

    Raises:
        UsageError: the file is a pipe.
    """
    from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, read_settings_from_gcode  # noqa: PLC0415 - slow

    if path.is_fifo():  # it can be read only once
        raise UsageError(
            f"{path}: is a pipe, but G-code files are read several times",
            remedy="Pipe it into stdin and use - as the file name, or write it to a file",
        )
    try:
        found = (
            FileSettings(read_settings_from_gcode(path), ())
            if is_printer_slicer_gcode(path)
            else _read_other_slicer_settings(path)
        )
    except (OSError, ValueError):  # an invalid file name
        return FileSettings({}, ())
    except ProfileError as error:
        # A file that cannot be read is reported when all of it is read.
        return FileSettings({}, (str(error.args[0]).removeprefix(f"{path}: "),) if path.is_file() else ())
    return _find_named_machine(path, folders) if found is None else found


def _read_other_slicer_settings(path: Path) -> FileSettings | None:
    """Read the profiles in a G-code file of another slicer; return None if the file has none."""
    from printer_slicer.importing import import_profiles  # noqa: PLC0415 - slow
    from printer_slicer.importing.results import NoSettingsError, RejectedProfile  # noqa: PLC0415 - slow

    try:
        found = import_profiles(path)
    except NoSettingsError:
        return None
    refused = [f"{one.kind}: {one.problem}" for one in found if isinstance(one, RejectedProfile)]
    return FileSettings(
        {one.kind: one.values for one in found if not isinstance(one, RejectedProfile)}, refused
    )


def _find_named_machine(path: Path, folders: Sequence[Path]) -> FileSettings:
    """Return the printer profile of the machine that a file names; if no profile has that name, only the name."""
    from printer_slicer.profile import load_profile, settings_as_dict  # noqa: PLC0415 - slow

    try:
        with path.open("rb") as file:
            head = file.read(_SEARCHED_BYTES)
            file.seek(max(path.stat().st_size - _SEARCHED_BYTES, len(head)))
            found = _MACHINE.search(head + b"\n" + file.read())
    except (OSError, ValueError):
        return FileSettings({}, ())  # reported when all of the file is read
    name = found[1].decode("utf-8", "replace").strip() if found else ""
    profile = find_profile_by_display_name("printer", name, folders) if name else ""
    if not profile:
        return FileSettings({}, (), name)
    return FileSettings(
        {"printer": settings_as_dict(load_profile(profile, slices=False, folders=folders))["printer"]}, ()
    )
