"""Check commands that a user types, before they are sent to a printer."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final

from printer_slicer.diagnostics import Diagnostic, check_allowed_codes
from printer_slicer.inspection.lint.scan import scan

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["make_command_check", "make_console_check"]

_REMEMBERED: Final = 500  # earlier commands of a console, for the units and modes that they set


def make_console_check(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """Return a function that checks commands typed in a row; each sets the units and modes for later ones."""
    allowed = check_allowed_codes(allowed)
    typed: deque[bytes] = deque(maxlen=_REMEMBERED)

    def explain_rejection(command: bytes) -> str:
        """Return why a command is rejected, or an empty text; rejected commands do not affect later commands."""
        typed.append(command)
        last = (one for one in scan(tuple(typed), profile) if one.index == len(typed) - 1)
        wrong = _describe_first_error(last, allowed)
        if wrong:
            typed.pop()
        return wrong

    return explain_rejection


def make_command_check(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """Return a function that checks single commands typed during a print."""

    def explain_rejection(command: bytes) -> str:
        """Return why a command is rejected; empty if it is accepted."""
        return _describe_first_error(scan([command], profile), allowed)

    return explain_rejection


def _describe_first_error(findings: Iterable[Diagnostic], allowed: Collection[str]) -> str:
    """Describe the first error that is not allowed; return an empty text if there is none."""
    wrong = (one for one in findings if one.is_error and one.code not in allowed)
    return next((f"{one.message}; {one.reason} [{one.code}]" for one in wrong), "")
