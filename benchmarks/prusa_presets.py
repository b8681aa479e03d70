"""Read the presets in the bundles of PrusaSlicer's vendors with PrusaSlicer itself.

PrusaSlicer's command line reads no bundles. So this module resolves inherited settings, without code of the importer.
PrusaSlicer does the rest: `--load flat.ini --save all.ini` adds its defaults and interprets every value, and
`--export-gcode` fills in its macros.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from configparser import RawConfigParser
from pathlib import Path

__all__ = ["BUNDLES", "FILAMENT", "Oracle", "bundles", "render_macros", "saved"]

BUNDLES = Path("/usr/share/PrusaSlicer/profiles")
MARK = ";==="
FILAMENT = "start_filament_gcode"  # settings that are one quoted text
KEPT_OUT = (
    "inherits",
    "compatible_printers",
    "compatible_printers_condition",
    "renamed_from",
    "print",
    "filament",
)


def bundles() -> list[Path]:
    """Return the bundles that are installed with PrusaSlicer; none if it is not installed."""
    return sorted(BUNDLES.glob("*.ini"))


class Oracle:
    """The presets of a bundle, with inherited settings."""

    def __init__(self, path: Path) -> None:
        self._parser = RawConfigParser(
            strict=False,
            delimiters=("=",),
            comment_prefixes=("#", ";"),
            default_section="",
            interpolation=None,
        )
        self._parser.optionxform = str  # type: ignore[assignment,method-assign]
        # A value may start with a semicolon, but a line that starts with one is a comment.
        self._parser.read_string(path.read_text(encoding="utf-8"))

    def names(self, kind: str) -> list[str]:
        """Return all presets of a kind (`printer`, `print`, `filament`) that are not abstract."""
        heads = [head.partition(":") for head in self._parser.sections()]
        return [name for one, _, name in heads if one == kind and not name.startswith("*")]

    def settings(self, kind: str, name: str) -> dict[str, str]:
        """Return the settings of a preset, including inherited ones."""
        own = dict(self._parser.items(f"{kind}:{name}"))
        whole: dict[str, str] = {}
        for parent in filter(None, (word.strip() for word in own.get("inherits", "").split(";"))):
            whole.update(self.settings(kind, parent))
        whole.update(own)
        return whole


def write_settings(settings: dict[str, str], path: Path) -> Path:
    """Write settings to a file for `--load`."""
    lines = [f"{key} = {value}\n" for key, value in settings.items() if key not in KEPT_OUT]
    path.write_text("".join(lines), encoding="utf-8")
    return path


def saved(settings: dict[str, str], folder: Path) -> dict[str, str]:
    """Return all settings as PrusaSlicer saves them."""
    whole = folder / "all.ini"
    whole.unlink(missing_ok=True)
    command = [
        "prusa-slicer",
        "--load",
        str(write_settings(settings, folder / "flat.ini")),
        "--save",
        str(whole),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    if not whole.exists():
        raise RuntimeError((done.stdout + done.stderr)[-500:])
    pairs = (line.partition(" = ") for line in whole.read_text(encoding="utf-8").splitlines())
    return {key.removesuffix(" ="): value for key, _, value in pairs if not key.startswith("#")}


def mark_macros(settings: dict[str, str]) -> dict[str, str]:
    """Return the same settings with marks around start and end G-code, and those of the filament."""
    around = settings | {
        key: f"{MARK}{key}\\n{settings.get(key, '')}\\n{MARK}" for key in ("start_gcode", "end_gcode")
    }
    text = settings.get(FILAMENT, "").strip()
    if text.startswith('"') and '";"' not in text:
        text = text[1 : text.rindex('"')]
        around[FILAMENT] = f'"{MARK}{FILAMENT}\\n{text}\\n{MARK}"'
    return around


def render_macros(settings: dict[str, str], part: Path, folder: Path) -> dict[str, list[str]] | str:
    """Return G-code of machine and filament as PrusaSlicer fills it in for settings (`mark_macros`), or its error."""
    gcode = folder / "peer.gcode"
    gcode.unlink(missing_ok=True)
    loaded = write_settings(settings, folder / "marked.ini")
    command = ["prusa-slicer", "--load", str(loaded), "-g", "-o", str(gcode), str(part)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    if not gcode.exists():
        return (done.stdout + done.stderr).strip().splitlines()[-1]
    return dict(commands_between_marks(gcode.read_text(encoding="utf-8", errors="replace")))


def commands_between_marks(gcode: str) -> Iterator[tuple[str, list[str]]]:
    """Return the commands between marks, without comments."""
    for name, text in re.findall(rf"^{MARK}(\w+)\n(.*?)^{MARK}$", gcode, re.DOTALL | re.MULTILINE):
        lines = (line.partition(";")[0].strip() for line in text.splitlines())
        yield name, [line for line in lines if line]
