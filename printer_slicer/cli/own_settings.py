"""Read the machine and material that a G-code file was sliced for from its comments."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from printer_slicer.importing.report import Imported, Refused

__all__ = ["OwnSettings", "own_settings", "provenance"]

_ENDS: Final = 1 << 14  # bytes at both ends of a file in which slicers name the machine
_MACHINE: Final = re.compile(
    rb"^; ?(?:TARGET_MACHINE\.NAME:|machine_type:|printer_model = |printer_settings_id = )([^\r\n]{1,100})",
    re.MULTILINE,
)
"""The machine as named by Cura, FlashPrint, and PrusaSlicer and its forks."""

_NAME: Final = re.compile(r'^name = "([^"\n]*)"', re.MULTILINE)


class OwnSettings(NamedTuple):
    """Settings found in a G-code file.

    Attributes:
        values: kind -> settings; kinds without settings in the file are missing.
        refused: reasons why settings in the file are not used, one sentence each.
        unknown: name of the machine in the file if no profile has that name, else empty.
    """

    values: Mapping[str, Mapping[str, Any]]
    refused: Sequence[str]
    unknown: str = ""


def own_settings(path: Path, folders: Sequence[Path] = ()) -> OwnSettings:
    """Read the settings that this program, PrusaSlicer or its forks wrote, or the name of the machine.

    Settings that an import would reject, such as impossible temperatures, are not used.

    Args:
        path: the G-code file.
        folders: further folders of profiles.

    Raises:
        UsageError: it is a pipe.
    """
    from printer_slicer.errors import ProfileError, UsageError
    from printer_slicer.importing.embedded import NoSettingsError
    from printer_slicer.importing.native import is_native, native_profiles
    from printer_slicer.importing.report import Refused

    if path.is_fifo():  # what is read of it here, nobody would judge
        raise UsageError(
            f"{path}: is a pipe, which can be read only once, and G-code is read several times",
            remedy="pipe it into stdin and name -, or write it to a file",
        )
    try:
        found = native_profiles(path) if is_native(path) else _foreign(path)
    except NoSettingsError:
        return _of_named_machine(path, folders)
    except (OSError, ValueError):  # an invalid file name
        return OwnSettings({}, ())
    except ProfileError as error:
        # A file that cannot be read is reported when all of it is read.
        return OwnSettings({}, (str(error.args[0]).removeprefix(f"{path}: "),) if path.is_file() else ())
    refused = [f"{one.kind}: {one.problem}" for one in found if isinstance(one, Refused)]
    return OwnSettings({one.kind: one.values for one in found if not isinstance(one, Refused)}, refused)


def _foreign(path: Path) -> Sequence[Imported | Refused]:
    """Read the profiles in G-code of another slicer."""
    from printer_slicer.importing import import_profiles

    return import_profiles(path)


def _of_named_machine(path: Path, folders: Sequence[Path]) -> OwnSettings:
    """Return the profile of the machine that a file without settings names, or the name if no profile has it."""
    from printer_slicer.profile import load_profile, settings_of

    try:
        with path.open("rb") as file:
            head = file.read(_ENDS)
            file.seek(max(path.stat().st_size - _ENDS, len(head)))
            found = _MACHINE.search(head + b"\n" + file.read())
    except (OSError, ValueError):
        return OwnSettings({}, ())  # reported when all of the file is read
    name = found[1].decode("utf-8", "replace").strip() if found else ""
    profile = _called("printer", name, folders) if name else ""
    if not profile:
        return OwnSettings({}, (), name)
    return OwnSettings(
        {"printer": settings_of(load_profile(profile, slices=False, folders=folders))["printer"]}, ()
    )


def provenance(
    names: Mapping[str, str | None], own: OwnSettings, folders: Sequence[Path]
) -> dict[str, dict[str, str]]:
    """Map each kind to the `name` of its profile, where it comes `from`, and an unknown machine `named_in_file`.

    Args:
        names: kind -> name on the command line; None if there is none.
        own: settings of the file.
        folders: further folders of profiles.
    """
    from printer_slicer.profile import DEFAULT_NAMES

    told: dict[str, dict[str, str]] = {}
    for kind, name in names.items():
        if name:
            told[kind] = {"name": name, "from": f"--{kind}"}
        elif kind in own.values:
            said = str(own.values[kind].get("name", ""))
            told[kind] = {"name": _called(kind, said, folders) or said, "from": "from the file"}
        else:
            told[kind] = {"name": DEFAULT_NAMES[kind], "from": "default"}
            if kind == "printer" and own.unknown:
                told[kind]["named_in_file"] = own.unknown
    return told


def _called(kind: str, name: str, folders: Sequence[Path] = ()) -> str:
    """Return the name that selects the profile with this `name` setting; empty if there is none."""
    from printer_slicer.profile import profile_paths

    for typed, path in profile_paths(kind, folders).items():
        found = _NAME.search(path.read_text(encoding="utf-8", errors="replace"))
        if found and found[1] == name:
            return typed
    return ""
