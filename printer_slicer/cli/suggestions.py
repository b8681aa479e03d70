"""Suggest a command or option in place of an unknown one: by meaning first, by spelling second."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Final

from printer_slicer.input_files import GCODE_SUFFIXES, MODEL_SUFFIXES
from printer_slicer.texts import find_similar_words

__all__ = ["suggest", "suggest_command", "suggest_option"]

_MIN_SIMILARITY: Final = 0.75  # from 0 to 1; less similar words are not suggested
_MIN_OPTION_SIMILARITY: Final = 0.85  # the same for options, whose words are often parts of others

_COMMANDS: Final[Mapping[str, str]] = {
    "export": "slice part.stl",
    "gcode": "slice part.stl",
    "generate": "slice part.stl",
    "simulate": "dry-run part.gcode",
    "simulation": "dry-run part.gcode",
    "dryrun": "dry-run part.gcode",
    "estimate": "dry-run part.gcode",
    "time": "dry-run part.gcode",
    "test": "dry-run part.gcode",
    "analyze": "check part.gcode",
    "analyse": "check part.gcode",
    "verify": "check part.gcode",
    "validate": "check part.gcode",
    "lint": "check part.gcode",
    "info": "check part.gcode",
    "preview": "draw part.gcode",
    "view": "draw part.gcode",
    "show": "draw part.gcode",
    "render": "draw part.gcode",
    "layers": "plan part.stl",
    "upload": "send part.gcode",
    "start": "print part.gcode --port PORT",
    "stream": "print part.gcode --port PORT",
    "connect": "console --port PORT",
    "terminal": "console --port PORT",
    "monitor": "console --port PORT",
    "pronsole": "console --port PORT",
    "pause": "control pause",
    "cancel": "control cancel",
    "stop": "control cancel",
    "abort": "control abort",
    "estop": "control abort",
    "m112": "control abort",
    "status": "control status",
    "recover": "resume",
    "list": "profiles",
    "printers": "profiles list printers",
    "materials": "profiles list materials",
    "filaments": "profiles list materials",
    "presets": "profiles",
    "profile": "profiles",
    "settings": "profiles settings",
    "config": "profiles settings",
    "import": "profiles import config.ini",
    "load": "profiles import config.ini",
    "devices": "ports",
    "port": "ports",
    "serial": "ports",
    "diagnose": "doctor",
    "simulator": "sim",
    "virtual": "sim",
    "help": "--help",
    "version": "--version",
}
"""Command that people try -> the command line of this program for it."""

_OPTIONS: Final[Mapping[str, str]] = {
    "--fill-density": "--infill PERCENT",
    "--infill-density": "--infill PERCENT",
    "--density": "--infill PERCENT",
    "--fill": "--infill PERCENT",
    "--fill-pattern": "--set infill=PATTERN",
    "--infill-pattern": "--set infill=PATTERN",
    "--pattern": "--set infill=PATTERN",
    "--wall-count": "--walls N",
    "--wall-loops": "--walls N",
    "--wall-line-count": "--walls N",
    "--shells": "--walls N",
    "--layer": "--layer-height MM",
    "--height": "--layer-height MM",
    "--layerheight": "--layer-height MM",
    "--max-layer": "--set max_layer=MM",
    "--min-layer": "--set min_layer=MM",
    "--first-layer-height": "--first-layer MM",
    "--support": "--supports",
    "--support-material": "--supports",
    "--enable-support": "--supports",
    "--brim-width": "--brim MM",
    "--no-brim": "--set brim_width=0",
    "--no-skirt": "--set skirt_loops=0",
    "--no-raft": "--set raft_height=0",
    "--skirts": "--set skirt_loops=N",
    "--raft": "--set raft_height=MM",
    "--raft-layers": "--set raft_layers=N",
    "--filament": "--material NAME",
    "--profile": "--printer NAME, --material NAME or --quality NAME",
    "--preset": "--printer NAME, --material NAME or --quality NAME",
    "--machine": "--printer NAME",
    "--config": "--load FILE",
    "--ini": "--load FILE",
    "--temperature": "--set nozzle_temperature=DEGREES",
    "--temp": "--set nozzle_temperature=DEGREES",
    "--nozzle-temperature": "--set nozzle_temperature=DEGREES",
    "--bed-temperature": "--set bed_temperature=DEGREES",
    "--bed-temp": "--set bed_temperature=DEGREES",
    "--nozzle": "--set nozzle_diameter=MM",
    "--nozzle-diameter": "--set nozzle_diameter=MM",
    "--speed": "--set speeds.perimeter=SPEED",
    "--print-speed": "--set speeds.perimeter=SPEED",
    "--skirt": "--set skirt_loops=N",
    "--nozzle-temp": "--set nozzle_temperature=DEGREES",
    "--bed": "--set bed_temperature=DEGREES",
    "--fan": "--set fan_ratio=PERCENT",
    "--fan-speed": "--set fan_ratio=PERCENT",
    "--flow": "--set flow_ratio=PERCENT",
    "--retraction": "--set retract_length=MM",
    "--top-layers": "--set top_solid_layers=N",
    "--bottom-layers": "--set bottom_solid_layers=N",
    "--variable-layer-height": "--quality adaptive",
    "--load-settings": "--load FILE",
    "--load-filaments": "--load FILE",
    "--printer-profile": "--printer NAME",
    "--material-profile": "--material NAME",
    "--vase": "--set spiral=true",
    "--spiralize": "--set spiral=true",
    "--linear-advance": "--set pressure_advance=VALUE",
    "--pressure-advance": "--set pressure_advance=VALUE",
    "--max-volumetric-speed": "--set max_flow=VALUE",
    "--spiral-vase": "--set spiral=true",
    "--duplicate": "--copies N",
    "--duplicate-grid": "--copies N",
    "--duplicate-distance": "--gap MM",
    "--merge": "--arrange",
    "--auto-arrange": "--arrange",
    "--dont-arrange": "--as-placed",
    "--count": "--copies N",
    "--quantity": "--copies N",
    "--out": "--output FILE",
    "--output-file": "--output FILE",
    "--outdir": "--output-dir DIR",
    "--export-gcode": "-o FILE.gcode",
    "--baudrate": "--baud N",
    "--speed-baud": "--baud N",
    "--device": "--port PORT",
    "--serial": "--port PORT",
    "--port": "--pty LINK or --tcp HOST:PORT",
    "--preview": "--picture FILE.svg",
    "--image": "--picture FILE.svg",
    "--png": "--picture FILE.png",
    "--svg": "--picture FILE.svg",
    "--adaptive": "--quality adaptive",
    "--quiet-mode": "--quiet",
    "--format": "--json",
}
"""Option that people try -> the option of this program for it."""

_ARGUMENTS: Final[Mapping[str, str]] = {
    "--model": "MODEL",
    "--models": "MODEL",
    "--part": "MODEL",
    "--stl": "MODEL",
    "--gcode": "FILE.gcode",
    "--file": "FILE.gcode",
    "--input": "FILE.gcode",
}
"""Option that people try -> the argument for it, where a command takes this argument without an option."""


def suggest(word: str, known: Iterable[str], cutoff: float = _MIN_SIMILARITY) -> str:
    """Return a question that suggests the known word with the most similar spelling; empty if none is similar."""
    near = find_similar_words(word, known, most=1, cutoff=cutoff) if word else []
    return f"Did you mean {near[0]!r}? " if near else ""


def suggest_command(word: str, commands: Collection[str]) -> str:
    """Return a question that suggests a command line in place of an unknown command; empty without a suggestion."""
    lower = word.lower()
    if lower.endswith(MODEL_SUFFIXES):
        return f"Did you mean 'printer-slicer slice {word}'? "
    if lower.endswith(GCODE_SUFFIXES):
        return f"Did you mean 'printer-slicer print {word} --port PORT', or dry-run, check or draw? "
    if lower in _COMMANDS:
        return f"Did you mean 'printer-slicer {_COMMANDS[lower]}'? "
    return suggest(lower, commands)


def suggest_option(flag: str, known: Collection[str], arguments: Iterable[str] = ()) -> str:
    """Return a question that suggests an option in place of an unknown one; empty without a suggestion.

    Args:
        flag: the option as typed, without its value.
        known: the options of the command.
        arguments: names of the arguments that the command takes without an option, such as "MODEL|FILE.gcode".
    """
    word = flag.lower().replace("_", "-")
    if (meant := _OPTIONS.get(word, "")) and _has_suggested_option(meant, known):
        return f"Did you mean {meant}? "
    given = _ARGUMENTS.get(word, "")
    if given and any(given in argument.split("|") for argument in arguments):
        return f"Did you mean {given} without {flag}? "
    if near := suggest(flag, _filter_by_first_letter(flag, known), _MIN_OPTION_SIMILARITY):
        return near
    setting = f"--set {word.removeprefix('--').replace('-', '_')}"
    return f"Did you mean {setting}=VALUE? " if _has_suggested_option(setting, known) else ""


def _filter_by_first_letter(flag: str, known: Iterable[str]) -> list[str]:
    """Return the options with the same first letter, which is rarely mistyped."""
    first = flag.lstrip("-")[:1]
    return [one for one in known if one.lstrip("-")[:1] == first]


def _has_suggested_option(meant: str, known: Collection[str]) -> bool:
    """Return whether a command has the suggested option; for --set, also whether it uses the suggested setting."""
    option, _, rest = meant.partition(" ")
    if option.rstrip(",") not in known:
        return False
    if option != "--set":
        return True
    from printer_slicer.importing.familiar import has_equivalent
    from printer_slicer.importing.prusaslicer_names import find_setting_kind
    from printer_slicer.profile.keys import find_section, is_setting

    name = rest.partition("=")[0]
    if not (is_setting(name) or has_equivalent(name)):
        return False
    return "--quality" in known or (find_section(name) or find_setting_kind(name)) != "quality"
