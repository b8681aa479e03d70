"""Reject options without effect: options for models if G-code is printed, or options of --model without --model."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Final

from printer_slicer.cli.setting_options import SETTING_OPTIONS
from printer_slicer.errors import UsageError

__all__ = ["reject_model_options", "reject_options_without_model"]

_MODEL_DEFAULTS: Final[Mapping[str, object]] = {
    "units": None,
    "scale": None,
    "rotate": None,
    "center": None,
    "as_placed": False,
    "arrange": False,
    "gap": None,
    "plate": None,
    "drop": True,
    "fuse": False,
    "copies": 1,
    "orient": "off",
    "orient_keep_up": None,
    "orient_row": None,
    "support_enforcer": [],
    "support_blocker": [],
    "modifier": [],
}
"""Defaults of the options for models."""
_SLICING_OPTIONS: Final = ("quality", "range", "set_for", "load", "strict", "strict_supports")
"""Options that only slicing uses, besides those that change one setting."""


def reject_model_options(arguments: argparse.Namespace) -> None:
    """Reject options for models and for slicing, and further files, if a G-code file is printed.

    Raises:
        UsageError: such an option, or more than one file, is given.
    """
    if len(arguments.models) > 1:
        raise UsageError(
            f"{arguments.models[0]}: only one G-code file can be printed at a time, not {len(arguments.models)}",
            remedy="Print the files one after the other, or slice the models together",
        )
    for flag in (*_find_model_options(arguments), *_find_slicing_options(arguments)):
        raise UsageError(
            f"{arguments.models[0]}: {flag} does not apply to G-code, which is already sliced",
            remedy=f"Leave out {flag}, or name the model instead of the G-code",
        )


def _find_model_options(arguments: argparse.Namespace) -> list[str]:
    """Return the options for units and placement of models on a command line."""
    given = [name for name, usual in _MODEL_DEFAULTS.items() if getattr(arguments, name, usual) != usual]
    return ["--no-drop" if name == "drop" else f"--{name.replace('_', '-')}" for name in given]


def _find_slicing_options(arguments: argparse.Namespace) -> list[str]:
    """Return the options on a command line that only slicing uses."""
    values = vars(arguments)
    given = {flag: values.get(f"setting {option.setting}") for flag, option in SETTING_OPTIONS.items()}
    given |= {"--heights": values.get("setting heights")}
    given |= {f"--{name.replace('_', '-')}": values.get(name) or None for name in _SLICING_OPTIONS}
    return [flag for flag, value in given.items() if value is not None]


def reject_options_without_model(arguments: argparse.Namespace, others: Sequence[str] = ()) -> None:
    """Reject options for the models of --model if --model is not given.

    Args:
        arguments: the command line.
        others: further options on it that need a model.

    Raises:
        UsageError: such an option is given without --model.
    """
    if not arguments.models and (given := [*others, *_find_model_options(arguments)]):
        draws = "; `printer-slicer draw FILE.gcode` draws a layer without it" if "--picture" in given else ""
        raise UsageError(
            f"{given[0]} has no effect without --model",
            remedy=f"Name the model of the G-code with --model FILE{draws}",
        )
