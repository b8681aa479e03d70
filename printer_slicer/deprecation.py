"""Warnings about names of the previous release, which still work in this one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

__all__ = ["accept_former_option", "renamed_method", "warn_renamed"]


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a Python name was replaced by another one.

    Args:
        old: the former name.
        new: the name that replaces it.
        stacklevel: number of calls between the user's code and the warning, as for `warnings.warn`.
    """
    warnings.warn(
        f"{old} is now called {new}; the former name works in this release only",
        FutureWarning,
        stacklevel=stacklevel,
    )


def accept_former_option(options: dict[str, Any], old: str, new: str) -> None:
    """Replace a former keyword argument by the current one, with a warning.

    Args:
        options: keyword arguments; changed in place.
        old: the former name.
        new: the current name; if both are given, the value of this one is used.
    """
    if old in options:
        warn_renamed(old, new, stacklevel=4)
        value = options.pop(old)
        options.setdefault(new, value)


def renamed_method(old: str, new: str) -> Callable[..., Any]:
    """Return a method that warns and calls the method that replaces it.

    Args:
        old: the former name, with its class.
        new: the current name, with its class.
    """

    def call(owner: Any, *args: Any, **options: Any) -> Any:
        """Call the current method of an object or a class."""
        warn_renamed(old, new)
        return getattr(owner, new.rpartition(".")[2])(*args, **options)

    return call
