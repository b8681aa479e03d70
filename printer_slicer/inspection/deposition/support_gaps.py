"""The gaps between supports and the part that do not count as air."""

from __future__ import annotations

from typing import Final

from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["USUAL_GAPS", "SupportGaps"]

_ROUNDING: Final = 0.02  # mm
_UNEVEN: Final = (
    0.25  # mm; supports have layers of their own, which do not begin exactly at the gap above the part
)


class SupportGaps(Struct, frozen=True):
    """Vertical gaps between supports and the part, up to which one counts as supported by the other.

    Attributes:
        above: from a support up to the part on it, mm.
        below: from the part up to a support on it, mm.
    """

    above: float = 0.32
    below: float = 0.45

    @classmethod
    def of(cls, profile: Profile) -> SupportGaps:
        """Return the gaps of a print: those that slicers usually leave, or larger ones in the settings."""
        slack = _find_largest(profile, "support_gap_slack") + _ROUNDING
        return cls(
            above=max(USUAL_GAPS.above, _find_largest(profile, "support_gap") + slack),
            below=max(USUAL_GAPS.below, _find_largest(profile, "support_bottom_gap") + _UNEVEN),
        )


USUAL_GAPS: Final = SupportGaps()
"""Gaps that slicers usually leave."""


def _find_largest(profile: Profile, name: str) -> float:
    """Return the largest value of a setting of the quality, among those for all, for objects and for heights."""
    names = (name, f"quality.{name}")
    own = (one.set[key] for one in profile.quality.overrides for key in names if key in one.set)
    return max(float(value) for value in (getattr(profile.quality, name), *own))
