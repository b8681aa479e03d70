"""Judge a cable by its resends, lost acknowledgements and the expected undetected damage.

An 8-bit checksum misses one in 256 of the lines that are damaged in several places. It also misses two flips of the
same bit position: with r resends per line, about r^2/16 of the lines. The larger of the two is the expected number of
undetected damaged lines.
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
"""Expected number of undetected damaged lines from which damage is called likely."""

_FEW: Final = 5
"""Resends, or lost acknowledgements, that happen on any cable."""

_PER_1000: Final = 2.0
"""Of either, the rate that a good cable stays below."""

_MANY: Final = 50
"""Of either, the count that causes a warning in a print of any length."""

_CHECK: Final = "use a short cable with ferrites, away from motors and heaters, and a USB port of its own"


class LinkQuality:
    """Counts link errors, and warns each time that their number doubles.

    Attributes:
        resends: number of resend requests.
        lost_answers: number of acknowledgements that got lost.
    """

    def __init__(self) -> None:
        self.resends = self.lost_answers = 0
        self._told = 0

    def heard(self, event: Event) -> None:
        """Count an event."""
        self.resends += isinstance(event, ResendAsked)
        self.lost_answers += isinstance(event, Asked)

    def warning(self, lines: int) -> PoorLink | None:
        """Return a warning after this number of lines; None if there is nothing new."""
        count = self.resends + self.lost_answers
        if count < 2 * self._told:
            return None
        found = poor_link(lines, self.resends, self.lost_answers)
        if found is not None:
            self._told = count
        return found


def poor_link(lines: int, resends: int, lost_answers: int) -> PoorLink | None:
    """Return a warning about a bad cable; None if the cable is good.

    Args:
        lines: number of acknowledged lines.
        resends: number of resend requests.
        lost_answers: number of acknowledgements that got lost.
    """
    worst = max(resends, lost_answers)
    per_1000 = 1000 * resends / max(lines, 1)
    if worst < _MANY and (worst <= _FEW or 1000 * worst <= _PER_1000 * lines):
        return None
    undetected = max(resends * _MISSED, lines * (resends / max(lines, 1)) ** 2 * _SAME_COLUMN)
    parts = [f"{resends} resends ({per_1000:.3g} per 1000 lines)"] if resends else []
    if lost_answers:
        parts.append(
            f"{lost_answers} lost acknowledgements, each of which may have stopped the nozzle on the part"
        )
    if undetected >= _LIKELY:
        parts.append("undetected damage is likely")
    text = f"bad cable: {'; '.join(parts)}: {_CHECK}"
    return PoorLink(lines, resends, lost_answers, round(per_1000, 3), round(undetected, 3), text)
