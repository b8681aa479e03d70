"""Apply the object settings of 3MF projects to a profile, and warn of parts of a model that have no effect."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from printer_slicer.profile import Profile, profile_with, settings_as_dict
from printer_slicer.profile.object_profiles import list_support_styles, list_unfollowed_settings

if TYPE_CHECKING:
    from printer_slicer.importing.projects import Project
    from printer_slicer.model import Mesh

__all__ = [
    "AppliedProjects",
    "apply_project_settings",
    "chooses_layer_height",
    "list_unused_model_warnings",
]

_LAYER_HEIGHT_KEYS = ("layer_height", "planner.kind")
_ZIP_SIGNATURE = b"PK"


class AppliedProjects(NamedTuple):
    """A profile with the object settings of 3MF projects.

    Attributes:
        profile: the changed profile.
        used: for each file, the settings that are used, one line per object.
        warnings: settings that are not used, and why.
    """

    profile: Profile
    used: Mapping[Path, tuple[str, ...]]
    warnings: tuple[str, ...]


def chooses_layer_height(keys: Iterable[str]) -> bool:
    """Return whether changes of settings with these keys choose a layer height or a planner."""
    return any(key.endswith(_LAYER_HEIGHT_KEYS) for key in keys)


def apply_project_settings(
    profile: Profile,
    paths: Iterable[Path],
    mesh: Mesh,
    *,
    names: Iterable[str] = (),
    keeps_layer_height: bool = False,
    has_quality: bool = True,
) -> AppliedProjects:
    """Apply the object settings of all 3MF files that contain some; the overrides of the profile take precedence.

    Args:
        profile: the profile for slicing.
        paths: model files; other formats and pipes are not read.
        mesh: the mesh, with the objects to print.
        names: further objects and modifiers whose settings are used.
        keeps_layer_height: whether layer heights of the projects are ignored, such as after `chooses_layer_height`.
        has_quality: whether the user chose a quality, so that nobody expects the settings of the project itself.

    Raises:
        UsageError: a project is damaged, or its settings contradict the profile.
    """
    projects = _read_projects(profile, paths, mesh, frozenset(names))
    if not projects:
        return AppliedProjects(profile, {}, ())
    changes: dict[str, object] = {}
    unused: list[str] = []
    tables: list[Mapping[str, Any]] = []
    for path, project in projects.items():
        tables += project.overrides
        unused += [f"{path.name}: {text}" for text in project.unused]
        if project.has_settings and not has_quality:
            unused.append(
                f"{path.name}: the print, filament and printer settings in this file are not used; "
                f"import them with `printer-slicer profiles import {path}`"
            )
        for name, height in project.layer_heights:
            if keeps_layer_height:
                unused.append(f"{path.name}: {name}: layer_height = {height:g} is not used")
            else:
                changes |= {"quality.planner.kind": "uniform", "quality.layer_height": height}
    if tables:
        own = settings_as_dict(profile)["quality"].get("overrides", [])
        changes["quality.overrides"] = [*tables, *own]
    used = {path: project.used for path, project in projects.items()}
    return AppliedProjects(profile_with(profile, changes) if changes else profile, used, tuple(unused))


def _read_projects(
    profile: Profile, paths: Iterable[Path], mesh: Mesh, names: frozenset[str]
) -> dict[Path, Project]:
    """Return file -> project, for all 3MF files that contain settings of a slicer."""
    found: dict[Path, Project] = {}
    for path in dict.fromkeys(paths):
        if not _is_3mf_file(path):
            continue
        from printer_slicer.importing.projects import read_project  # noqa: PLC0415 - only for 3MF files

        volumes = mesh.all_volumes
        modifiers = {one.name for one in volumes.modifiers} if volumes else set()
        project = read_project(path, profile, modifiers | {item.name for item in mesh.objects} | names)
        if project.overrides or project.layer_heights or project.unused or project.has_settings:
            found[path] = project
    return found


def _is_3mf_file(path: Path) -> bool:
    """Return whether a path is a regular file that starts like a 3MF file; pipes are not read."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_ZIP_SIGNATURE)) == _ZIP_SIGNATURE


def list_unused_model_warnings(mesh: Mesh, profile: Profile) -> list[str]:
    """Return warnings about volumes, painted facets and supports that have no effect, or an unexpected one."""
    return [*_list_volume_warnings(mesh, profile), *_list_spiral_warnings(profile)]


def _list_spiral_warnings(profile: Profile) -> list[str]:
    """Return a warning if supports are asked for in spiral mode, which cannot print them."""
    if not profile.quality.spiral or list_support_styles(profile) == {"off"}:
        return []
    return ["no supports are printed in spiral mode; to print them, set spiral = false"]


def _list_volume_warnings(mesh: Mesh, profile: Profile) -> list[str]:
    """Return warnings about volumes and painted facets that have no effect, or an unexpected one."""
    volumes, quality = mesh.all_volumes, profile.quality
    styles = list_support_styles(profile)
    has_enforcers = volumes is not None and volumes.has_enforcers
    found = []
    if quality.support_places == "enforced" and styles != {"off"} and not has_enforcers:
        found.append(
            "supports are made only in enforced places, and the model has none; set support_places = all for others"
        )
    if volumes is None:
        return found
    if (
        len(mesh.objects) > 1
        and not all(item.count for item in mesh.objects)
        and any(item.volumes for item in mesh.objects)
    ):
        found.append(
            "the mesh needs repair; after that, volumes and painted facets apply to all objects, not only to their own"
        )
    if volumes.has_enforcers and styles == {"off"}:
        what = "support enforcers" if volumes.enforce else "facets painted for supports"
        found.append(f"the model has {what}, but supports are off; to use them, set support = auto")
    for name in dict.fromkeys(one.name for one in volumes.modifiers):
        if not any(one.object == name for one in quality.overrides):
            found.append(f"the modifier {name!r} has no settings; give it some in quality.overrides")
        elif unfollowed := list_unfollowed_settings(profile, name):
            found.append(f"the modifier {name!r} does not change {', '.join(unfollowed)}")
    if volumes.negative:
        found.append("layer heights and the surface deviation are computed without the negative volumes")
    return found
