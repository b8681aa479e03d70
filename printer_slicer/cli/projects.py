"""What 3MF projects on the command line say of how their objects shall be printed, laid over the profile."""

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
    """The profile with what objects of 3MF projects have of their own, and what of the projects is not used.

    What is used is told on stderr, what is not is a warning there. What was typed, or is in the profile, comes over it.

    Args:
        arguments: of the command line.
        profile: that it describes.
        mesh: all models; its items are the objects that are printed.
        plate: what is known of them; what is not used comes to its warnings.

    Raises:
        UsageError: a project's archive is damaged, or its settings contradict the profile.
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
    """What each 3MF file says; those that no slicer made say nothing, and are left out."""
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
    """Whether it is a file, not a pipe that could be read only once, and begins as 3MF files do."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_ARCHIVE)) == _ARCHIVE


def _changes(
    arguments: argparse.Namespace, profile: Profile, projects: Mapping[Path, Project]
) -> tuple[dict[str, object], list[str]]:
    """The settings to change, and what is not used."""
    typed = changes_from(arguments)
    changes: dict[str, object] = {}
    unused: list[str] = []
    tables: list[Mapping[str, Any]] = []
    for path, project in projects.items():
        tables += project.overrides
        unused += [f"{path.name}: {text}" for text in project.unused]
        if project.has_settings and arguments.quality is None:
            unused.append(
                f"{path.name}: its settings of print, filament and printer are not used; "
                f"`printer-slicer profiles import {path}` makes profiles of them"
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
