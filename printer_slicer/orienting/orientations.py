"""Orientations of a part, with the figures by which they are compared."""

from __future__ import annotations

from typing import Final

from printer_slicer.values import Struct

__all__ = ["Orientation", "Orientations"]

_GIVEN_MARGIN: Final = 0.05  # share of the cost that turning the part must save


class Orientation(Struct, frozen=True):
    """One orientation of a part.

    Attributes:
        rotate: degrees about the fixed axes x, y and z, in this order, as `transform` takes them.
        cost: print time, support and surface deviation together, at their prices, min.
        minutes: print time including supports, min.
        support_g: filament of supports, g.
        deviation: mean distance of the printed surface from that of the part, mm.
        surface_area: area of the surface, mm².
        height: height of the turned part, mm.
        contact_area: area of the convex hull of the part just above the bed, mm².
        overhang: area of overhangs that need support, seen from above, mm².
        tilt_deg: how far the part can be tilted before it falls over, degrees; negative: it falls over at once.
        is_original: whether this is how the part lies in its file.
        is_stable: whether the part stands safely on the bed.
        fits: whether the turned part fits the printer.
        is_sliced: whether minutes, grams and deviation were measured by slicing the part; else they are estimates.
    """

    rotate: tuple[float, float, float]
    cost: float
    minutes: float
    support_g: float
    deviation: float
    surface_area: float
    height: float
    contact_area: float
    overhang: float
    tilt_deg: float
    is_original: bool = False
    is_stable: bool = True
    fits: bool = True
    is_sliced: bool = False

    @property
    def deviation_volume(self) -> float:
        """The deviation times the area of the surface, mm³."""
        return self.deviation * self.surface_area

    @property
    def is_usable(self) -> bool:
        """Whether the part can be printed like this: it stands safely and fits the printer."""
        return self.is_stable and self.fits

    def format_rotate(self) -> str:
        """Return the angles as the command line takes them, such as `90,0,-12.5`."""
        return ",".join(f"{angle:.6f}".rstrip("0").rstrip(".") for angle in self.rotate)

    def describe_rotation(self) -> str:
        """Return by which angles the part was rotated."""
        return (
            "not rotated" if self.is_original else f"rotated by {self.format_rotate()} degrees about x, y, z"
        )

    def format_comment(self, name: str, search: str) -> str:
        """Return how a part was rotated by a search, for the head of the G-code."""
        return f"{name}: {self.describe_rotation()} (orient: {search})"


class Orientations(Struct, frozen=True):
    """Orientations of a part, best first; those that are not usable come last.

    Attributes:
        rows: at least one; exactly one of them is the part as given.
    """

    rows: tuple[Orientation, ...]

    @property
    def original(self) -> Orientation:
        """The part as it lies in its file."""
        return next(row for row in self.rows if row.is_original)

    @property
    def chosen(self) -> Orientation:
        """The best row, or the part as given if the best one saves less than 5 %."""
        best, given = self.rows[0], self.original
        saves = best.cost < (1 - _GIVEN_MARGIN) * given.cost
        return best if best.is_usable and (saves or not given.is_usable) else given
