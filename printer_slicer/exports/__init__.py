"""Write contours as SVG, Common Layer Interface (CLI) and StereoLithography Contours (SLC).

The output depends only on the sections: it has no dates and no file names. Each writer documents its rounding in its
docstring and, if the format allows, in the file.
"""

from printer_slicer.exports.cli_format import CLI_UNITS, write_cli
from printer_slicer.exports.resampling import resample, smooth
from printer_slicer.exports.rounding import RoundedRings, round_to_float32, round_to_grid
from printer_slicer.exports.slc_format import has_uneven_heights, write_slc
from printer_slicer.exports.svg_format import SVG_DIGITS, write_svg, write_svgs

__all__ = [
    "CLI_UNITS",
    "SVG_DIGITS",
    "RoundedRings",
    "has_uneven_heights",
    "resample",
    "round_to_float32",
    "round_to_grid",
    "smooth",
    "write_cli",
    "write_slc",
    "write_svg",
    "write_svgs",
]
