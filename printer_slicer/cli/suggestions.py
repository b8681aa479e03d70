"""Suggestions for commands and options that do not exist: by meaning first, by spelling second, else none."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from difflib import get_close_matches
from typing import Final

__all__ = ["suggest", "suggest_command", "suggest_option"]

_ALIKE: Final = 0.75  # of 1: a word this similar is suggested

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
    "abort": "control cancel",
    "status": "control status",
    "recover": "resume",
    "list": "profiles",
    "printers": "profiles",
    "materials": "profiles",
    "filaments": "profiles",
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
"""A word people try -> what does it here."""

_OPTIONS: Final[Mapping[str, str]] = {
    "--fill-density": "--infill 20%",
    "--infill-density": "--infill 20%",
    "--density": "--infill 20%",
    "--fill": "--infill 20%",
    "--fill-pattern": "--set infill=gyroid",
    "--infill-pattern": "--set infill=gyroid",
    "--pattern": "--set infill=gyroid",
    "--wall-count": "--walls 3",
    "--wall-loops": "--walls 3",
    "--wall-line-count": "--walls 3",
    "--shells": "--walls 3",
    "--layer": "--layer-height 0.2",
    "--height": "--layer-height 0.2",
    "--layerheight": "--layer-height 0.2",
    "--first-layer-height": "--first-layer 0.2",
    "--support": "--supports",
    "--support-material": "--supports",
    "--enable-support": "--supports",
    "--brim-width": "--brim 5",
    "--skirts": "--set skirt_loops=2",
    "--raft": "--set raft_height=0.6",
    "--raft-layers": "--set raft_height=0.6",
    "--filament": "--material pla",
    "--profile": "--printer NAME, --material NAME or --quality NAME",
    "--preset": "--printer NAME, --material NAME or --quality NAME",
    "--machine": "--printer NAME",
    "--config": "--load config.ini",
    "--ini": "--load config.ini",
    "--temperature": "--set nozzle_temperature=210",
    "--temp": "--set nozzle_temperature=210",
    "--nozzle-temperature": "--set nozzle_temperature=210",
    "--bed-temperature": "--set bed_temperature=60",
    "--bed-temp": "--set bed_temperature=60",
    "--nozzle": "--set nozzle_diameter=0.4",
    "--nozzle-diameter": "--set nozzle_diameter=0.4",
    "--speed": "--set speeds.perimeter=50",
    "--vase": "--set spiral=true",
    "--spiral-vase": "--set spiral=true",
    "--duplicate": "--copies 2",
    "--count": "--copies 2",
    "--out": "--output FILE",
    "--output-file": "--output FILE",
    "--outdir": "--output-dir DIR",
    "--export-gcode": "-o FILE.gcode",
    "--baudrate": "--baud 115200",
    "--speed-baud": "--baud 115200",
    "--device": "--port PORT",
    "--serial": "--port PORT",
    "--preview": "--picture FILE.svg",
    "--image": "--picture FILE.svg",
    "--png": "--picture FILE.png",
    "--svg": "--picture FILE.svg",
    "--adaptive": "--quality adaptive",
    "--quiet-mode": "--quiet",
    "--format": "--json",
}
"""An option people try -> what does it here."""

_MODELS: Final = (".stl", ".3mf", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp")
_GCODE: Final = (".gcode", ".gco", ".g")


def suggest(word: str, known: Iterable[str]) -> str:
    """Return a question that names the known word spelled most like a word; empty if none is similar."""
    near = get_close_matches(word, list(known), n=1, cutoff=_ALIKE) if word else []
    return f"Did you mean {near[0]!r}? " if near else ""


def suggest_command(word: str, commands: Collection[str]) -> str:
    """Return a question that names the command line that a first word may mean; empty if none is meant."""
    lower = word.lower()
    if lower.endswith(_MODELS):
        return f"Did you mean 'printer-slicer slice {word}'? "
    if lower.endswith(_GCODE):
        return f"Did you mean 'printer-slicer print {word} --port PORT', or dry-run, check or draw? "
    if lower in _COMMANDS:
        return f"Did you mean 'printer-slicer {_COMMANDS[lower]}'? "
    return suggest(lower, commands)


def suggest_option(flag: str, known: Collection[str]) -> str:
    """Return a question that names the option of a command that an unknown one may mean; empty if none is meant.

    Args:
        flag: as typed, without a value.
        known: the options of the command.
    """
    meant = _OPTIONS.get(flag.lower().replace("_", "-"), "")
    if meant.partition(" ")[0].rstrip(",") in known:
        return f"Did you mean {meant}? "
    if near := suggest(flag, known):
        return near
    if "--set" in known and _is_setting(name := flag.removeprefix("--").replace("-", "_")):
        return f"Did you mean --set {name}=VALUE? "
    return ""


def _is_setting(name: str) -> bool:
    """Return whether a name is a setting here or in another slicer."""
    from printer_slicer.importing.familiar import is_familiar
    from printer_slicer.profile.keys import is_setting

    return is_setting(name) or is_familiar(name)
