"""Cura's definitions: a machine that inherits from others, its first extruder, changes of single settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.cura_names import CURA_DEFAULTS, from_cura
from printer_slicer.importing.cura_values import Unreadable, evaluate_cura
from printer_slicer.importing.ini import Entry, Section, read_sections
from printer_slicer.importing.orca import read_json
from printer_slicer.importing.presets import Preset, number_in
from printer_slicer.importing.unpacking import text_of, unpacked

__all__ = ["Definition", "cura_presets", "cura_profile", "is_definition"]

_SUFFIX: Final = ".def.json"


def is_definition(values: Mapping[str, Any]) -> bool:
    """Whether a JSON file is a definition of Cura's."""
    return "version" in values and ("overrides" in values or isinstance(values.get("settings"), dict))


@dataclass(slots=True)
class Definition:
    """A machine with what it inherits.

    Attributes:
        name: people's name of it.
        place: its file.
        settings: key -> its properties, `value` and `default_value` among them.
        changes: key -> value that a person gave.
        changed_at: where.
        own: keys that the machine's own files change.
        asked: the setting that was asked for last, not counting those that it hangs on.
    """

    name: str
    place: str
    settings: dict[str, dict[str, Any]]
    changes: dict[str, str] = field(default_factory=dict)
    changed_at: dict[str, str] = field(default_factory=dict)
    own: list[str] = field(default_factory=list)
    unread: dict[str, str] = field(default_factory=dict)
    asked: str = ""
    _values: dict[str, Any] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    @property
    def consulted(self) -> set[str]:
        """The settings that somebody asked for, directly or by way of others."""
        return set(self._values)

    def where(self, key: str) -> str:
        """Where a setting has its value from: a change, or the definition."""
        return self.changed_at.get(key, self.place)

    def value(self, key: str) -> Any:
        """The value of a setting; of an expression that is not understood the default.

        Raises:
            Unreadable: there is no such setting, or it hangs on itself.
        """
        if not self._open:
            self.asked = key
        if key in self._values:
            return self._values[key]
        if key in self._open:
            raise Unreadable(f"{key} hangs on itself")
        if key not in self.settings and key not in self.changes:
            raise Unreadable(f"{key} is no setting of this machine")
        self._open.append(key)
        try:
            found = self._computed(key)
        finally:
            self._open.pop()
        self._values[key] = found
        return found

    def _computed(self, key: str) -> Any:
        properties = self.settings.get(key, {})
        given = self.changes.get(key)
        if given is not None:
            try:
                return _typed(given, str(properties.get("type", "")), self)
            except Unreadable as error:
                raise ProfileError(
                    f"{self.changed_at[key]}: {key}: {error}",
                    remedy="change it in Cura, or with --cura KEY=VALUE",
                ) from None
        default = properties.get("default_value")
        expression = properties.get("value", default)
        if "value" not in properties or not isinstance(expression, str):
            return expression
        try:
            return evaluate_cura(expression, self.value)
        except Unreadable as error:
            self.unread[key] = str(error)
            return default


def _typed(text: str, kind: str, machine: Definition) -> Any:
    """A value that a person gave: an expression behind `=`, else as the setting's type says."""
    if text.startswith("="):
        return evaluate_cura(text[1:], machine.value)
    if kind == "bool" or text.lower() in ("true", "false"):
        return text.strip().lower() in ("true", "1", "yes")
    number = number_in(text) if kind not in ("str", "enum") else None
    if number is None or number.percent:
        return text
    return int(text) if kind == "int" and text.strip().isdigit() else number.value


def cura_presets(
    values: Mapping[str, Any],
    path: Path,
    folders: Sequence[Path],
    changes: Mapping[str, Entry],
    name: str = "",
) -> list[Preset]:
    """Printer, material and quality of a machine as Cura has them by default, with some settings changed.

    Args:
        values: of its definition.
        path: its file.
        folders: where others are that it inherits from, besides its own.
        changes: key -> value and place.
        name: of the profile that they are from, which material and quality are called by.

    Raises:
        ProfileError: what it inherits from is not there, or a change that makes no sense.
    """
    around = [path.parent, *folders]
    machine = Definition(str(values.get("name") or path.stem), str(path), {})
    for own, file in reversed(list(_chain(dict(values), path, around))):
        _add(machine, own, base=file.name.startswith("fdm"))
    _extruder(machine, values, around)
    for key, entry in changes.items():
        if key not in machine.settings:
            raise ProfileError(
                f"{entry.place}: {key}: Cura has no such setting", remedy="look up its name in the definition"
            )
        machine.changes[key], machine.changed_at[key] = entry.text, entry.place
    entries = _translated(machine)
    entries |= {key: entry for key, entry in changes.items() if key not in machine.consulted}
    names = {
        "printer": machine.name,
        "material": f"{name or machine.name} material",
        "quality": name or f"{machine.name} quality",
    }
    return [
        Preset(kind, name, "cura", machine.place, entries, CURA_DEFAULTS, mixed=True)
        for kind, name in names.items()
    ]


def _translated(machine: Definition) -> dict[str, Entry]:
    """The settings of a machine under PrusaSlicer's names.

    Raises:
        ProfileError: it has too few, or one of a value that nothing can be made of.
    """
    try:
        return from_cura(machine.value, machine.where)
    except Unreadable as error:
        raise ProfileError(
            f"{machine.place}: {error}",
            remedy="give the definition of a machine, not one that others build on",
        ) from None
    except (TypeError, ValueError, ArithmeticError):
        key = machine.asked
        raise ProfileError(
            f"{machine.where(key)}: {key}: its value makes no sense",
            remedy=f"change it with --cura {key}=VALUE",
        ) from None


def _chain(
    values: dict[str, Any], path: Path, folders: Sequence[Path]
) -> Iterator[tuple[dict[str, Any], Path]]:
    """A definition and those it inherits from, itself first."""
    seen = [path.name]
    yield values, path
    while parent := values.get("inherits"):
        name = f"{parent}{_SUFFIX}"
        if name in seen:
            raise ProfileError(
                f"{path}: inherits from itself: {' -> '.join([*seen, name])}", remedy="break the circle"
            )
        near = [] if "/" in name else [folder / name for folder in folders]
        found = next((one for one in near if one.is_file()), None)
        if found is None:
            raise ProfileError(
                f"{path}: inherits {parent!r}: {name} is not beside it",
                remedy="name the folder of Cura's definitions with --folder",
            )
        seen.append(name)
        values, path = _read(found), found
        yield values, path


def _read(path: Path) -> dict[str, Any]:
    return read_json(text_of(path), str(path))


def _add(machine: Definition, values: Mapping[str, Any], *, base: bool) -> None:
    """The settings that a definition declares, and the properties that it changes."""
    pending = [values.get("settings")]
    while pending:
        table = pending.pop()
        for key, properties in table.items() if isinstance(table, dict) else ():
            if isinstance(properties, dict):
                machine.settings[key] = {name: one for name, one in properties.items() if name != "children"}
                pending.append(properties.get("children"))
    overrides = values.get("overrides")
    for key, properties in overrides.items() if isinstance(overrides, dict) else ():
        if isinstance(properties, dict):
            machine.settings[key] = machine.settings.get(key, {}) | properties
            machine.own += [] if base else [key]


def _extruder(machine: Definition, values: Mapping[str, Any], folders: Sequence[Path]) -> None:
    """What the first extruder says of itself."""
    trains: Any = None
    for own, _ in _chain(dict(values), Path(machine.place), folders):
        metadata = own.get("metadata")
        trains = trains or (metadata.get("machine_extruder_trains") if isinstance(metadata, dict) else None)
    name = trains.get("0") if isinstance(trains, dict) else None
    if not isinstance(name, str) or "/" in name:
        return
    places = [place for folder in folders for place in (folder, folder.parent / "extruders")]
    found = next(
        (place / f"{name}{_SUFFIX}" for place in places if (place / f"{name}{_SUFFIX}").is_file()), None
    )
    if found is not None:
        _add(machine, {"overrides": _read(found).get("overrides")}, base=False)


def cura_profile(path: Path, text: str) -> tuple[str, str, dict[str, Entry]]:
    """The machine's definition that a profile (`.inst.cfg`, `.curaprofile`) is for, its name, and what it changes.

    Args:
        path: the file.
        text: of it; empty for `.curaprofile`, which holds several.

    Raises:
        ProfileError: it is none.
    """
    texts = [text] if text else list(unpacked(path).values())
    machine = name = ""
    changes: dict[str, Entry] = {}
    for one in texts:
        sections: Mapping[str, Section] = {
            section.title: section for section in read_sections(one.splitlines(), str(path))
        }
        if "general" in sections and "values" in sections:
            machine = sections["general"].texts.get("definition", machine)
            name = name or sections["general"].texts.get("name", "")
            changes |= sections["values"].entries
    if not machine:
        raise ProfileError(f"{path}: no profile of Cura's", remedy="export it in Cura under Manage Profiles")
    return machine, name or path.name.partition(".")[0], changes
