"""Apply the object settings of 3MF projects on the command line to the profile."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.common import changes_from, visible
from printer_slicer.cli.models import Plate, warn
from printer_slicer.profile import profile_with, settings_of

if TYPE_CHECKING:
    from printer_slicer.importing.projects import Project
    from printer_slicer.model import Mesh
    from printer_slicer.profile import Profile

__all__ = ["with_projects"]

_ARCHIVE = b"PK"


def with_projects(
    arguments: argparse.Namespace, profile: Profile, mesh: Mesh, plate: Plate
) -> tuple[Profile, Plate]:
    """Return the profile with the object settings of 3MF projects, and the plate with warnings about unused settings.

    Used settings are listed on stderr, unused ones as warnings. The command line and the profile take precedence.

    Args:
        arguments: the command line.
        profile: the profile from the command line.
        mesh: all models; its items are the objects to print.
        plate: facts about the models.

    Raises:
        UsageError: a project is damaged, or its settings contradict the profile.
    """
    projects = _projects(arguments, profile, mesh)
    if not projects:
        return profile, plate
    changes, unused = _changes(arguments, profile, projects)
    if not arguments.quiet:
        for path, project in projects.items():
            for text in project.used:
                print(visible(f"printer-slicer: {path.name}: {text}"), file=sys.stderr)
    warn(arguments, unused)
    plate = replace(plate, warnings=(*plate.warnings, *unused))
    return profile_with(profile, changes) if changes else profile, plate


def _projects(arguments: argparse.Namespace, profile: Profile, mesh: Mesh) -> dict[Path, Project]:
    """Read the projects of all 3MF files that hold settings of a slicer."""
    found: dict[Path, Project] = {}
    for path in arguments.models:
        if not _is_archive(path):
            continue
        from printer_slicer.importing.projects import read_project

        project = read_project(path, profile, {item.name for item in mesh.items})
        if project.overrides or project.layer_heights or project.unused or project.has_settings:
            found[path] = project
    return found


def _is_archive(path: Path) -> bool:
    """Whether it is a regular file, not a pipe, and starts as 3MF files do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_ARCHIVE)) == _ARCHIVE


def _changes(
    arguments: argparse.Namespace, profile: Profile, projects: Mapping[Path, Project]
) -> tuple[dict[str, object], list[str]]:
    """Return the settings to change, and messages about unused settings."""
    typed = changes_from(arguments)
    changes: dict[str, object] = {}
    unused: list[str] = []
    tables: list[Mapping[str, Any]] = []
    for path, project in projects.items():
        tables += project.overrides
        unused += [f"{path.name}: {text}" for text in project.unused]
        if project.has_settings and arguments.quality is None:
            unused.append(
                f"{path.name}: its print, filament and printer settings are not used; "
                f"import them with `printer-slicer profiles import {path}`"
            )
        for name, height in project.layer_heights:
            if len(arguments.models) > 1 or any(
                key.endswith(("layer_height", "planner.kind")) for key in typed
            ):
                unused.append(f"{path.name}: {name}: layer_height = {height:g} is not used")
            else:
                changes |= {"quality.planner.kind": "uniform", "quality.layer_height": height}
    if tables:
        there = settings_of(profile)["quality"].get("overrides", [])
        changes["quality.overrides"] = [*tables, *there]
    return changes, unused
