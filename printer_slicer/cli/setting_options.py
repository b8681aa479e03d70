"""Options that change one setting, and their help, which the profile declares."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Final, NamedTuple

__all__ = ["SETTING_OPTIONS", "SettingOption"]

_OPTIMAL: Final = " (only with --planner optimal)"


class SettingOption(NamedTuple):
    """An option that changes one setting.

    Attributes:
        setting: key of the setting.
        metavar: name of the value in the help; empty: the option has no value and sets `value_if_omitted`.
        help_suffix: text after the meaning of the setting in the help.
        is_advanced: whether only --help-all shows it, among the options of the layer planner; without a value,
            among those of the models.
        alias: another name of the option.
        value_if_omitted: value if the option is given without one; empty: a value is required.
        meaning: text of the help before the suffix; empty: the meaning of the setting.
    """

    setting: str
    metavar: str
    help_suffix: str = ""
    is_advanced: bool = True
    alias: str = ""
    value_if_omitted: str = ""
    meaning: str = ""

    @property
    def help(self) -> str:
        """Return the meaning of the setting, as declared in the profile, and its choices."""
        if self.meaning:
            return self.meaning + self.help_suffix
        meaning, choices = _read_setting_meanings()[self.setting]
        return meaning + (f"; one of: {choices}" if choices else "") + self.help_suffix


SETTING_OPTIONS: Final[Mapping[str, SettingOption]] = {
    "--layer-height": SettingOption(
        "quality.layer_height", "MM", is_advanced=False, meaning="uniform layer height"
    ),
    "--infill": SettingOption(
        "quality.infill_density",
        "PERCENT",
        is_advanced=False,
        meaning="infill density, such as 20%",
    ),
    "--walls": SettingOption(
        "quality.perimeters", "N", is_advanced=False, alias="--perimeters", meaning="number of perimeters"
    ),
    "--supports": SettingOption(
        "quality.support",
        "STYLE",
        is_advanced=False,
        value_if_omitted="auto",
        meaning="supports: auto (if no STYLE), columns, tree or off",
    ),
    "--brim": SettingOption(
        "quality.brim_width",
        "MM",
        is_advanced=False,
        value_if_omitted="5",
        meaning="brim around the part, MM wide; without MM: 5 mm",
    ),
    "--sequential": SettingOption(
        "quality.print_order",
        "",
        value_if_omitted="by_object",
        meaning="print the parts one after the other",
    ),
    "--planner": SettingOption("quality.planner.kind", "NAME"),
    "--tolerance": SettingOption("quality.tolerance", "MM"),
    "--first-layer": SettingOption("quality.first_layer_height", "MM"),
    "--containment": SettingOption(
        "quality.containment",
        "NAME",
        meaning="side of the surface on which layers may deviate: mid (both sides), positive (only outside) or "
        "negative (only inside)",
    ),
    "--objective": SettingOption(
        "quality.planner.objective",
        "NAME",
        _OPTIMAL,
        meaning="quantity to minimize: balanced (print time plus the price of the volume error), time (print time), "
        "layers (number of layers) or volume (volume error)",
    ),
    "--error-price": SettingOption(
        "quality.planner.error_price",
        "S",
        meaning="seconds of print time worth spending to avoid 1 mm³ of volume error; 0: computed from "
        "error_price_ratio (only with --planner optimal --objective balanced)",
    ),
    "--snap": SettingOption(
        "quality.planner.snap_tolerance",
        "MM",
        _OPTIMAL,
        meaning="align layer tops with flat surfaces within this distance; 0: half of printer.z_step",
    ),
    "--max-step": SettingOption(
        "quality.planner.max_step",
        "MM",
        _OPTIMAL,
        meaning="maximum height difference between neighbouring layers; 0: follows from the setting smooth",
    ),
    "--max-layers": SettingOption(
        "quality.planner.max_layers",
        "N",
        _OPTIMAL,
        meaning="maximum number of layers; the planner minimizes the volume error within it; 0: no limit",
    ),
    "--time-budget": SettingOption(
        "quality.planner.time_budget",
        "TIME",
        _OPTIMAL,
        meaning="maximum estimated print time, such as 90m, 1h30m or 5400 (seconds); the planner minimizes the volume "
        "error within it; 0: no limit",
    ),
}
"""Option -> the setting that it changes, in the order of the help."""


@cache
def _read_setting_meanings() -> Mapping[str, tuple[str, str]]:
    """Map settings to meaning and choices; keys of the optimal planner's settings omit the planner's name."""
    from printer_slicer.profile.tables import list_setting_definitions

    rows = [row for row in list_setting_definitions() if "[" not in row.key or "[optimal]" in row.key]
    return {row.key.replace("[optimal]", ""): (row.meaning, row.choices) for row in rows}
