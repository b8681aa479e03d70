"""Colours of layer heights and roles, suitable for colour-blind people.

Heights use viridis (van der Walt and Smith, 2015; the table is in the public domain, CC0). Equal steps look equal and
lightness increases steadily, so the scale also works in grey. Other colours are greys and the set of Okabe and Ito,
"Color universal design", 2008.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.roles import ROLES, Role

__all__ = [
    "CALM",
    "ROLE_COLOURS",
    "WARNING",
    "choose_height_colours",
    "darken",
    "mix_colours",
    "parse_colour",
]

CALM: Final = "#5b8fb0"  # for pictures with a single colour
WARNING: Final = "#d55e00"
ROLE_COLOURS: Final[dict[Role, str]] = {role: ROLES[role].colour for role in Role if role != Role.TRAVEL}
# Every sixteenth of viridis; linear interpolation stays within 6 of its 255 steps.
_VIRIDIS: Final = (
    *("#440154", "#48186a", "#472d7b", "#424086", "#3b528b", "#33638d", "#2c728e", "#26828e", "#21918c"),
    *("#1f9f88", "#27ad81", "#3dbc74", "#5cc863", "#81d34d", "#aadc32", "#d5e21a", "#fde725"),
)
# Middle of the used part of the scale, and its half length for 6 and for 2 heights. The ends of the scale are unused:
# the darkest colours cannot be darkened, the lightest are invisible on white.
_MIDDLE, _MAX_REACH, _MIN_REACH, _MANY_HEIGHTS = 0.53, 0.37, 0.29, 6


def parse_colour(colour: str) -> Float:
    """Return red, green and blue (3,) of a colour "#rrggbb"."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)], np.float64)


def _format_colour(numbers: Float) -> str:
    """Return the colour "#rrggbb" for red, green and blue (3,)."""
    red, green, blue = np.clip(np.rint(numbers), 0, 255).astype(int).tolist()
    return f"#{red:02x}{green:02x}{blue:02x}"


def choose_height_colours(heights: Float) -> list[str]:
    """Choose the colour of each layer by its height: dark for thin, light for thick layers; all equal: one colour.

    Args:
        heights: (L,) mm, layer heights.
    """
    values, which = np.unique(heights, return_inverse=True)
    if len(values) < 2:
        return [CALM] * len(heights)
    # Mix height and rank, so that nearly equal heights still look different.
    share = (values - values[0]) / (values[-1] - values[0]) / 2 + np.linspace(0, 0.5, len(values))
    reach = float(np.interp(len(values), [2, _MANY_HEIGHTS], [_MIN_REACH, _MAX_REACH]))
    place = (_MIDDLE + reach * (2 * share - 1)) * (len(_VIRIDIS) - 1)
    stops = np.array([parse_colour(colour) for colour in _VIRIDIS])
    table = np.column_stack([np.interp(place, np.arange(len(stops)), column) for column in stops.T])
    names = [_format_colour(row) for row in table]
    return [names[i] for i in which.ravel().tolist()]


def darken(colour: str, light: float) -> str:
    """Darken a colour: `light` 1 keeps it, 0 makes it black."""
    return _format_colour(parse_colour(colour) * light)


def mix_colours(colour: str, other: str, share: float) -> str:
    """Mix two colours; `share` is the fraction of `other`, from 0 to 1."""
    return _format_colour(parse_colour(colour) * (1 - share) + parse_colour(other) * share)
