"""Whether a cable can be trusted: how often lines were asked for again, answers got lost, and what nobody notices.

A checksum of 8 bits misses one in 256 of the lines that are damaged in several places, and of single flipped bits those
that hit the same column twice: with r resends a line, about r^2/16 of the lines. Whichever is more is what must be
expected on the bed without anybody having been told.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.stream.events import Asked, PoorLink, ResendAsked

if TYPE_CHECKING:
    from printer_slicer.stream.events import Event

__all__ = ["LinkQuality", "poor_link"]

_MISSED: Final = 1 / 256
_SAME_COLUMN: Final = 1 / 16
_LIKELY: Final = 0.25
"""Damaged lines to be expected from which on one is called likely."""

_FEW: Final = 5
"""Resends, or lost answers, that happen on any cable."""

_PER_1000: Final = 2.0
"""Of either that a sound cable stays below."""

_MANY: Final = 50
"""Of either that are worth a word in a print of any length."""

_CHECK: Final = "check the cable: a short one with ferrites, away from motors and heaters, its own USB port"


class LinkQuality:
    """Counts what went wrong, and says so each time that it has doubled.

    Attributes:
        resends: times that the printer asked for lines again.
        lost_answers: times that it had to be asked what became of a line.
    """

    def __init__(self) -> None:
        self.resends = self.lost_answers = 0
        self._told = 0

    def heard(self, event: Event) -> None:
        """Something happened."""
        self.resends += isinstance(event, ResendAsked)
        self.lost_answers += isinstance(event, Asked)

    def warning(self, lines: int) -> PoorLink | None:
        """What to tell after so many lines; None if there is nothing new."""
        count = self.resends + self.lost_answers
        if count < 2 * self._told:
            return None
        found = poor_link(lines, self.resends, self.lost_answers)
        if found is not None:
            self._told = count
        return found


def poor_link(lines: int, resends: int, lost_answers: int) -> PoorLink | None:
    """What to tell of a cable, None if it is sound.

    Args:
        lines: that were answered.
        resends: times that the printer asked for lines again.
        lost_answers: times that it had to be asked what became of a line.
    """
    worst = max(resends, lost_answers)
    per_1000 = 1000 * resends / max(lines, 1)
    if worst < _MANY and (worst <= _FEW or 1000 * worst <= _PER_1000 * lines):
        return None
    undetected = max(resends * _MISSED, lines * (resends / max(lines, 1)) ** 2 * _SAME_COLUMN)
    parts = [f"lines were asked for again {resends} times, {per_1000:.3g} per 1000 lines"] if resends else []
    if lost_answers:
        parts.append(
            f"{lost_answers} answers got lost, and the nozzle may have stood still on the part for each"
        )
    if undetected >= _LIKELY:
        parts.append("undetected damage is likely")
    text = f"{'; '.join(parts)}: {_CHECK}"
    return PoorLink(lines, resends, lost_answers, round(per_1000, 3), round(undetected, 3), text)
