"""Profiles from TOML files: found by name, inherited, changed from the command line, checked.

A profile has three parts, one file each: `printers/NAME.toml`, `materials/NAME.toml`, `qualities/NAME.toml`. A file may
say `inherits = "OTHER"`; its own keys win. Changes such as `quality.perimeters = 3` come last and obey the same bounds.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.profile.checks import conflicts
from printer_slicer.profile.lists import list_as_text, list_from_text
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.settings import (
    PLANNER_SETTINGS,
    Accelerations,
    Material,
    OptimalPlanner,
    Printer,
    Quality,
    Speeds,
)

__all__ = [
    "DEFAULT_NAMES",
    "KINDS",
    "load_profile",
    "part_settings",
    "profile_paths",
    "profile_root",
    "profile_with",
    "settings_table",
    "settings_text",
]

KINDS: Mapping[str, type[msgspec.Struct]] = {"printer": Printer, "material": Material, "quality": Quality}
_BARE_POINT = re.compile(r"([-+]?)([0-9]*)\.([0-9]*)")
_FOLDERS = {"printer": "printers", "material": "materials", "quality": "qualities"}
DEFAULT_NAMES: Mapping[str, str] = {"printer": "marlin_220", "material": "pla", "quality": "adaptive"}

_INNER = {"speeds": Speeds, "accelerations": Accelerations}
_LISTS = ("layer_heights", "pause_at", "planner.ranges", "thumbnails")


class _Source(NamedTuple):
    """Settings of one kind as read, the place each key came from, and the place of what is missing."""

    values: dict[str, Any]
    places: dict[str, str]
    file: str

    def place(self, path: str) -> str:
        """Where a key, or a table that holds it or is held by it, was set."""
        path = path.partition("[")[0]  # an entry of a list was set where the list was
        for key in reversed(self.places):
            if path and (f"{key}.".startswith(f"{path}.") or f"{path}.".startswith(f"{key}.")):
                return self.places[key]
        return self.file


def profile_root() -> Path:
    """The folder of the shipped profiles: beside the package in a checkout, inside it when installed."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "profiles"
    return (
        beside if (package.parent / "pyproject.toml").is_file() and beside.is_dir() else package / "profiles"
    )


def profile_paths(kind: str) -> dict[str, Path]:
    """The shipped profiles of one kind (`printer`, `material`, `quality`): name -> file, by name."""
    return {path.stem: path for path in sorted((profile_root() / _FOLDERS[kind]).glob("*.toml"))}


def load_profile(
    printer: str | None = None,
    material: str | None = None,
    quality: str | None = None,
    changes: Mapping[str, object] | None = None,
    *,
    slices: bool = True,
) -> Profile:
    """The profile made of three parts and some changes.

    Args:
        printer: name of a shipped profile or path of a TOML file; None takes the default, as for the other two.
        material: likewise.
        quality: likewise.
        changes: `section.key` or, where it is unique, `key` -> value; text is converted to the setting's type.
        slices: whether parts are sliced with it, so that printer, material and quality must suit each other.

    Raises:
        ProfileError: naming file, key and bound.
    """
    asked = {"printer": printer, "material": material, "quality": quality}
    sources = {kind: _read_chain(kind, name or DEFAULT_NAMES[kind], ()) for kind, name in asked.items()}
    return _build(_changed(sources, changes or {}), slices=slices)


def _changed(sources: dict[str, _Source], changes: Mapping[str, object]) -> dict[str, _Source]:
    """The sources with all changes applied; the planner's kind first, since the other planner settings hang on it."""
    for key, value in sorted(changes.items(), key=lambda change: not change[0].endswith("planner.kind")):
        _change(sources, key, value)
    return sources


def profile_with(profile: Profile, changes: Mapping[str, object]) -> Profile:
    """The same profile with some settings changed; bounds are checked, unlike by the structs' constructors.

    Args:
        profile: stays as it is.
        changes: as for `load_profile`.

    Raises:
        ProfileError: a change that is out of bounds, or of a setting that there is not.
    """
    sources = {
        kind: _Source(
            msgspec.to_builtins(getattr(profile, kind)), {}, f"{kind} {getattr(profile, kind).name!r}"
        )
        for kind in KINDS
    }
    return _build(_changed(sources, changes))


def settings_text(profile: Profile) -> Iterator[tuple[str, object]]:
    """All settings, flat: (`section.key`, value) in the order they are declared."""
    for kind in KINDS:
        for path, value in _flatten(msgspec.to_builtins(getattr(profile, kind))):
            yield f"{kind}.{path}", value


def part_settings(kind: str, name: str) -> dict[str, object]:
    """All settings of one part of a profile as it is used, with what it inherits and the defaults: key -> value.

    Raises:
        ProfileError: no such part, or it has a fault of its own.
    """
    return dict(_flatten(msgspec.to_builtins(_convert(kind, _read_chain(kind, name, ())))))


def settings_table() -> Iterator[tuple[str, str, str, str, str, str]]:
    """One row per setting: (key, type, unit, bounds, default, meaning)."""
    for kind, struct in KINDS.items():
        yield from _describe(kind, struct)


def _describe(prefix: str, struct: type) -> Iterator[tuple[str, str, str, str, str, str]]:
    info = msgspec.inspect.type_info(struct)
    assert isinstance(info, msgspec.inspect.StructType)
    for entry in info.fields:
        key = f"{prefix}.{entry.encode_name}"
        nested = entry.type.types if isinstance(entry.type, msgspec.inspect.UnionType) else (entry.type,)
        if all(isinstance(one, msgspec.inspect.StructType) for one in nested):
            if len(nested) > 1:
                kinds = " | ".join(
                    str(one.tag) for one in nested if isinstance(one, msgspec.inspect.StructType)
                )
                yield (
                    f"{key}.kind",
                    "literal",
                    "",
                    kinds,
                    "optimal",
                    "which strategy; the others' settings are refused",
                )
            for one in nested:
                assert isinstance(one, msgspec.inspect.StructType)
                yield from _describe(f"{key}[{one.tag}]" if one.tag else key, one.cls)
            continue
        yield _row(key, entry)


def _row(key: str, entry: msgspec.inspect.Field) -> tuple[str, str, str, str, str, str]:
    kind, unit, meaning = entry.type, "", ""
    if isinstance(kind, msgspec.inspect.Metadata):
        unit = str((kind.extra or {}).get("unit", ""))
        meaning = str((kind.extra_json_schema or {}).get("description", ""))
        kind = kind.type
    names = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
    limits = [
        f"{sign} {getattr(kind, name):g}"
        for name, sign in names.items()
        if getattr(kind, name, None) is not None
    ]
    if isinstance(kind, msgspec.inspect.LiteralType):
        limits = [" | ".join(map(str, kind.values))]
    default = "required" if entry.default is msgspec.NODEFAULT else str(entry.default)
    name = (
        "list" if isinstance(kind, msgspec.inspect.VarTupleType) else type(kind).__name__.removesuffix("Type")
    )
    return key, name.lower(), unit, ", ".join(limits), default.replace("()", "") or "empty", meaning


def _flatten(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flatten(value, f"{prefix}{key}.")
        else:
            yield prefix + key, list_as_text(value) if isinstance(value, list | tuple) else value


def _find(kind: str, name: str, beside: Path, asked_by: str) -> Path:
    """The file of a profile, by name or by path; a relative path begins at `beside`."""
    if name.endswith(".toml") or "/" in name:
        path = beside / name
        if not path.is_file():
            raise ProfileError(
                f"{asked_by}{path}: no such {kind} profile",
                remedy="check the path, or name a shipped profile",
            )
        return path
    known = profile_paths(kind)
    if name in known:
        return known[name]
    near = get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ProfileError(
        f"{asked_by}unknown {kind} {name!r}",
        remedy=f"{hint}known: {', '.join(known)}; or give the path of a .toml file",
    )


def _read_chain(kind: str, name: str, seen: tuple[Path, ...]) -> _Source:
    """The settings of a file over those of the file it inherits from."""
    beside = seen[-1].parent if seen else Path()
    path = _find(kind, name, beside, f"{seen[-1]}: inherits: " if seen else "")
    if path in seen:
        raise ProfileError(
            f"{path}: inherits from itself by way of {seen[-1].name}", remedy="break the circle"
        )
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ProfileError(
            f"{path}: not valid TOML: {error}", remedy="mend the line that the message names"
        ) from None
    except OSError as error:
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror}", remedy="check the file's permissions"
        ) from None
    parent = values.pop("inherits", None)
    if parent is not None and not isinstance(parent, str):
        raise ProfileError(f"{path}: inherits: expected the name of a profile, got {parent!r}")
    base = _read_chain(kind, parent, (*seen, path)) if parent else _Source({}, {}, str(path))
    places = base.places | {key: str(path) for key, _ in _flatten(values)}
    return _Source(_merge(base.values, values), places, str(path))


def _merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """`over` on top of `base`, table by table; a table of another `kind` replaces the whole table."""
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if (
            isinstance(value, dict)
            and isinstance(old, dict)
            and value.get("kind", old.get("kind")) == old.get("kind")
        ):
            result[key] = _merge(old, value)
        else:
            result[key] = value
    return result


def _change(sources: dict[str, _Source], key: str, value: object) -> None:
    """Apply one change in place."""
    kind, path = _resolve(sources, key)
    value = list_from_text(path, value) if path in _LISTS and isinstance(value, str) else _plain(value)
    *tables, leaf = path.split(".")
    change: dict[str, Any] = {leaf: value}
    for table in reversed(tables):
        change = {table: change}
    source = sources[kind]
    if tables and not isinstance(source.values.get(tables[0], {}), dict):
        return  # the file has a plain value where a table belongs, which the conversion will refuse by name
    merged = _merge(source.values, change)
    sources[kind] = _Source(merged, source.places | {path: f"--set {key}={value}"}, source.file)


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as Python's own, typed numbers with a digit before the point and one behind it."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str):
        found = _BARE_POINT.fullmatch(value.strip())
        return (
            f"{found[1].strip('+')}{found[2] or 0}.{found[3] or 0}"
            if found and (found[2] or found[3])
            else value
        )
    return value.tolist() if hasattr(value, "tolist") else value


def _keys(kind: str, values: Mapping[str, Any]) -> list[str]:
    """All keys that may be set in a section as it stands: the planner's own settings depend on its kind."""
    struct = KINDS[kind]
    keys = [name for name in struct.__struct_fields__ if name not in ("planner", *_INNER)]
    if kind == "quality":
        table = values.get("planner")
        chosen = table.get("kind", "optimal") if isinstance(table, dict) else "optimal"
        planner = PLANNER_SETTINGS.get(str(chosen), OptimalPlanner)
        keys += [f"planner.{name}" for name in ("kind", *planner.__struct_fields__)]
        keys += [f"{inner}.{name}" for inner, owner in _INNER.items() for name in owner.__struct_fields__]
    return keys


def _resolve(sources: Mapping[str, _Source], key: str) -> tuple[str, str]:
    """Which section and key a change means: `quality.perimeters`, or `perimeters` where only one section has it."""
    known = [(kind, path) for kind, source in sources.items() for path in _keys(kind, source.values)]
    exact = [(kind, path) for kind, path in known if f"{kind}.{path}" == key]
    matches = exact or [(kind, path) for kind, path in known if path == key]
    if len(matches) == 1:
        return matches[0]
    if matches:
        choices = ", ".join(f"{kind}.{path}" for kind, path in matches)
        raise ProfileError(f"--set {key}: more than one section has this key", remedy=f"say which: {choices}")
    leaf = key.rpartition(".")[2]
    having = [kind for kind, struct in PLANNER_SETTINGS.items() if leaf in struct.__struct_fields__]
    if having and key in (leaf, f"planner.{leaf}", f"quality.planner.{leaf}"):
        raise ProfileError(
            f"--set {key}: the chosen planner has no such setting",
            remedy=f"it belongs to: {', '.join(f'--planner {kind}' for kind in having)}",
        )
    everything = {f"{kind}.{path}" for kind, path in known} | {path for _, path in known}
    near = get_close_matches(key, sorted(everything), n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ProfileError(
        f"--set {key}: no such setting", remedy=f"{hint}`printer-slicer profiles settings` lists all"
    )


def _build(sources: Mapping[str, _Source], *, slices: bool = True) -> Profile:
    """The checked profile."""
    parts = {kind: _convert(kind, source) for kind, source in sources.items()}
    profile = Profile(**parts)
    for key, problem, remedy in conflicts(profile) if slices else ():
        kind, _, path = key.partition(".")
        raise ProfileError(f"{sources[kind].place(path)}: {key}: {problem}", remedy=remedy)
    return profile


def _convert(kind: str, source: _Source) -> Any:
    """One section as a struct; an error names place, key and bound."""
    try:
        return msgspec.convert(source.values, KINDS[kind], strict=False)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$")
        path = where.rstrip("`").lstrip(".")
    if "unknown field" in problem:
        name = problem.split("`")[1]
        path = f"{path}.{name}".lstrip(".")
        known = _keys(kind, source.values)
        near = get_close_matches(path, known, n=1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
        raise ProfileError(f"{source.place(path)}: {kind}.{path}: no such setting", remedy=hint) from None
    given = _lookup(source.values, path)
    choices = _choices(KINDS[kind], path)
    remedy = (
        f"choose one of: {choices}"
        if choices
        else "`printer-slicer profiles settings` tells type, unit and bounds"
    )
    what = f"{kind}.{path}" if path else kind
    raise ProfileError(
        f"{source.place(path)}: {what}: {problem.replace('`', '')}{given}", remedy=remedy
    ) from None


def _choices(struct: type[msgspec.Struct], path: str) -> str:
    """The allowed values of a setting that is one of a few words; nothing for other settings."""
    if path == "planner.kind":
        return ", ".join(PLANNER_SETTINGS)
    rows = {re.sub(r"\[\w+\]", "", row[0]): row for row in _describe("", struct)}
    row = rows.get(f".{path}")
    return row[3].replace(" |", ",") if row and row[1] == "literal" else ""


def _lookup(values: Mapping[str, Any], path: str) -> str:
    """The offending value for the message; nothing where the problem already quotes it or a key is missing."""
    found: Any = values
    for key in path.split("."):
        if not isinstance(found, Mapping) or key not in found:
            return ""
        found = found[key]
    return "" if isinstance(found, Mapping) else f"; it is {found!r}"
