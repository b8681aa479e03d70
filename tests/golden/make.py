"""Write the golden file: a box of 10 x 10 x 0.8 mm in three layers, one with internal infill, with its own settings.

    python -m tests.golden.make

Review the difference before you keep the file: every changed line changes the print.
"""

from __future__ import annotations

from pathlib import Path

from printer_slicer.gcode_text import gcode_of
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile
from tests.parts import box

__all__ = ["FILE", "made"]

FOLDER = Path(__file__).parent
FILE = FOLDER / "box.gcode"


def made() -> bytes:
    """The text as the package makes it now."""
    printer, material, quality = (str(FOLDER / f"{kind}.toml") for kind in ("printer", "material", "quality"))
    profile = load_profile(printer, material, quality)
    return gcode_of(slice_part(box((10, 10, 0.8)), profile), profile)


if __name__ == "__main__":
    FILE.write_bytes(made())
