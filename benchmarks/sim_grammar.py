"""Patterns for every line that each firmware may send, to check the simulated printer."""

from __future__ import annotations

import re
from functools import cache

from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES

__all__ = ["grammar"]

_REAL = r"-?(?:\d+\.\d+|inf|nan)"
_PLACE = rf"X:{_REAL} Y:{_REAL} Z:{_REAL} E:{_REAL} Count X:-?\d+ Y:-?\d+ Z:-?\d+"
_HEAT = rf"T:{_REAL} /{_REAL} B:{_REAL} /{_REAL}(?: T\d:{_REAL} /{_REAL})* @:\d+ B@:\d+(?: @\d:\d+)*"
_MARLIN = (
    *(r"ok", rf"ok {_HEAT}", rf" {_HEAT}", rf" {_HEAT} W:(?:\?|-?\d+)", rf"{_HEAT}", _PLACE),
    *(r"echo:busy: (?:processing|paused for user)", r"FR:\d+%", r"echo:E0 Flow: \d+%", r"echo:M113 S\d+"),
    *(
        r"echo:Print time: (?:\d+[dhm] )*\d+s",
        r"echo: (?:cold|too long) extrusion prevented",
        r"Error:G2/G3 bad parameters",
    ),
    *(r"echo:Cold extrudes are (?:en|dis)abled \(min temp -?\d+C\)", r"Reporting endstop status"),
    *(r"[xyz]_min: (?:open|TRIGGERED)", r"echo:Soft endstops: (?:On|Off)  Min:  .*", r"echo:Home XYZ First"),
    *(
        r"Cap:[A-Z_0-9]+:[01]",
        r"(?:echo:)?(?:; [A-Za-z /()0-9]+:|  [GM]\d+ .*)",
        r"echo:(?:[MT]\d+ )?T?\d*\.?\d* ?Invalid extruder ?-?\d*",
    ),
    *(r"echo:Active Extruder: \d", r"Begin file list", r"End file list", r"echo:SD card (?:ok|released)"),
    *(
        r"[^ ]+ \d+",
        r"open failed, File: .*\.",
        r"echo:Now fresh file: .*",
        r"File opened: .* Size: \d+",
        r"File selected",
    ),
    *(
        r"SD printing byte \d+/\d+",
        r"Not SD printing",
        r"Current file: .*",
        r"Writing to file: .*",
        r"Done saving file\.",
    ),
    *(
        r"Error:error writing to file",
        r"File deleted:.*",
        r"Deletion failed, File: .*\.",
        r"Done printing file",
    ),
    *(r"Error:(?:MINTEMP|MAXTEMP) triggered, system stopped! Heater_ID: (?:E\d|bed)", r""),
    *(r"Error:(?:Heating failed|Thermal Runaway), system stopped! Heater_ID: (?:E\d|bed)",),
)
_HEAT_KLIPPER = rf"B:{_REAL} /{_REAL}(?: T\d:{_REAL} /{_REAL})+"
_KLIPPER = (
    *(r"ok", rf"ok {_HEAT_KLIPPER}", _HEAT_KLIPPER, rf"X:{_REAL} Y:{_REAL} Z:{_REAL} E:{_REAL}", r"echo: .*"),
    *(
        r"!! Unable to parse move '[^\n]*'",
        rf"!! Must home axis first: {_REAL} {_REAL} {_REAL} \[{_REAL}\]",
        rf"!! Move out of range: {_REAL} {_REAL} {_REAL} \[{_REAL}\]",
    ),
    *(r"!! Extrude below minimum temp", rf"!! Extrude only move too long \({_REAL}mm vs {_REAL}mm\)"),
    *(
        rf"!! Move exceeds maximum extrusion \({_REAL}mm\^2 vs {_REAL}mm\^2\)",
        r"// See the '\w+' config option for details",
    ),
    *(
        rf"!! Requested temperature \({_REAL}\) out of range \({_REAL}:{_REAL}\)",
        r"// Klipper state: (?:Ready|Disconnect|Shutdown)",
    ),
    *(r"(?://|!!) Shutdown due to M112 command", r"// Once the underlying issue is corrected, use the"),
    *(
        r'// "FIRMWARE_RESTART" command to reset the firmware, reload the',
        r"// config, and restart the host software\.",
    ),
    *(
        r"// Printer is shutdown",
        r"!! Heater \w+: .*",
        r"(?://|!!) (?:Err: \w+|Heating failed|Thermal Runaway|Homing Failed)",
    ),
    *(r"Reporting endstop status", r"[xyz]_min: (?:open|TRIGGERED)", r"FR:\d+%", r"echo:E0 Flow: \d+%"),
    r"!! Extruder not configured",
)
_HEAT_VIRTUAL = rf"T:{_REAL}/ {_REAL}(?: T\d:{_REAL}/ {_REAL})* B:{_REAL}/ {_REAL} @:64"
_NUMBER = r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?"
_VIRTUAL = (
    *(rf"ok {_HEAT_VIRTUAL}", rf" {_HEAT_VIRTUAL}", rf"T:{_REAL}"),
    rf"ok X:{_NUMBER} Y:{_NUMBER} Z:{_NUMBER} E:{_NUMBER} Count: A:-?\d+ B:-?\d+ C:-?\d+",
)
_ACTIONS = (
    r"//action:(?:poweroff|paused(?: filament_runout \d)?|resumed?|cancel|prompt_\w+(?: .*)?|notification .*)"
)
_FIELDS = {
    "last": r"-?\d+",
    "wanted": r"-?\d+",
    "got": r"-?\d+",
    "text": r".*",
    "reason": r".*",
    "what": r".*",
    "heater": r"\w+",
}


def _fill_pattern(words: str) -> str:
    """Return the pattern of a message with fields."""
    parts = re.split(r"\{(\w+)\}", words)
    return "".join(_FIELDS[part] if i % 2 else re.escape(part) for i, part in enumerate(parts))


@cache
def grammar(name: str) -> re.Pattern[str]:
    """Return a pattern for every line that a firmware sends, except texts of M118."""
    firmware = SIMULATED_FIRMWARES[name]
    lines = [re.escape(line) for line in firmware.banner]
    said: tuple[str, ...] = (
        firmware.wrong_number,
        firmware.wrong_checksum,
        firmware.no_checksum,
        firmware.no_number,
        firmware.unknown_reply,
    )
    said += (*firmware.resend.split("\n"), *firmware.halt_messages, *firmware.heater_fault_messages)
    lines += map(_fill_pattern, said)
    lines += [
        r".*FIRMWARE_NAME:.*",
        r"skip -?\d+",
        r"RX timeout",
        r"Full RX Buffer",
        r"wait",
        r"echo: M110 N-?\d+",
    ]
    lines += _KLIPPER if firmware.language == "klipper" else _MARLIN
    lines += _VIRTUAL if firmware.language == "virtual" else ()
    lines += (r"ok(?: N-?\d+)? P\d+ B-?\d+", _ACTIONS, r"area:\{.*\}") if firmware.advanced_ok else ()
    return re.compile("|".join(f"(?:{line})" for line in lines), re.DOTALL)
