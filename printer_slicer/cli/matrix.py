"""Profiles of all combinations of settings in --matrix."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from printer_slicer.cli.settings import collect_changes, load_selected_profile
from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.profile import KINDS

if TYPE_CHECKING:
    from printer_slicer.batching.tasks import Combination

__all__ = ["add_matrix_option", "load_combinations"]


def add_matrix_option(group: argparse._ActionsContainer, what: str) -> argparse.Action:
    """Add --matrix, and return it; `what` is done for each combination."""
    return group.add_argument(
        "--matrix",
        metavar="KEY=A,B",
        action="append",
        default=[],
        help=f"{what} with each value of a setting; may be repeated",
    )


def load_combinations(arguments: argparse.Namespace) -> list[Combination]:
    """Load the profile of each combination; print names and origins of the first one.

    Raises:
        UsageError: a setting of --matrix is invalid, or given by another option, too.
    """
    from printer_slicer.batching.matrix import combine_choices, parse_choices

    try:
        choices = parse_choices(arguments.matrix)
        combinations = combine_choices(choices)
    except UsageError as error:
        raise UsageError(f"--matrix {error.args[0]}", remedy=error.remedy) from None
    for kind in KINDS:
        if kind in choices and getattr(arguments, kind, None) is not None:
            raise UsageError(f"--matrix {kind}: --{kind} is given, too", remedy=f"Leave out --{kind}")
    return [_load(arguments, chosen, tell=at == 0) for at, chosen in enumerate(combinations)]


def _load(arguments: argparse.Namespace, choices: Mapping[str, str], *, tell: bool) -> Combination:
    """Load the profile of one combination."""
    from printer_slicer.batching.tasks import Combination
    from printer_slicer.project_settings import chooses_layer_height

    own = argparse.Namespace(**vars(arguments))
    own.set = [*arguments.set, *(f"{key}={value}" for key, value in choices.items() if key not in KINDS)]
    for kind in KINDS:
        setattr(own, kind, choices.get(kind, getattr(arguments, kind, None)))
    try:
        profile = load_selected_profile(own, tell=tell)
    except ProfileError as error:
        given = " ".join(f"{key}={value}" for key, value in choices.items())
        where = f"--matrix {given}: " if given else ""
        raise UsageError(f"{where}{error.args[0]}", remedy=error.remedy) from None
    if tell:
        arguments.profile_facts = own.profile_facts
    keeps = chooses_layer_height(collect_changes(own))
    return Combination(choices, profile, keeps, own.quality is not None)
