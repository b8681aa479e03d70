"""What can be typed about profiles: `profiles` and the flags that choose them."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from printer_slicer.cli.importing import add_import
from printer_slicer.cli.parsing import command, later, output

__all__ = ["add_profiles", "add_settings"]

_Commands = argparse._SubParsersAction  # noqa: SLF001 - the type of what add_subparsers gives has no other name

WHAT: Final = {
    "list": "all profiles with what they are for; a KIND shows only those",
    "show": "all settings of one, or of the print that the flags describe, and where each value comes from",
    "diff": "in which settings two of them differ",
    "new": "write a file to begin with: KIND NAME",
    "import": "make profiles from those of other slicers: `profiles import --help` says more",
    "check": "everything that is wrong with files, by line",
    "path": "the folders that are looked into, or where one profile lies",
    "settings": "all settings with type, unit, bounds and default; a WORD shows only those with it",
    "schema": "write JSON Schema files, from which editors complete and check profiles",
}
_EXAMPLES: Final = """\
  printer-slicer profiles
  printer-slicer profiles show prusa_mk3s
  printer-slicer profiles show --printer voron_0_2 --material petg --set perimeters=4
  printer-slicer profiles diff standard fine
  printer-slicer profiles new printer my_printer --inherits marlin_220
  printer-slicer profiles import config.ini
  printer-slicer profiles check my_printer.toml --json
  printer-slicer profiles settings infill
  printer-slicer profiles schema -o schemas"""


def add_settings(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The flags that choose profiles and change settings."""
    group = parser.add_argument_group("settings")
    group.add_argument("--printer", metavar="NAME", help="printer profile, or path of a .toml file")
    group.add_argument("--material", metavar="NAME", help="material profile, likewise")
    group.add_argument("--quality", metavar="NAME", help="quality profile, likewise")
    group.add_argument(
        "--profiles",
        metavar="FOLDER",
        type=Path,
        action="append",
        default=[],
        help="look for profiles there first; may be repeated",
    )
    group.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one setting; may be repeated"
    )
    return group


def add_profiles(commands: _Commands[argparse.ArgumentParser]) -> None:
    """The command `profiles`."""
    parser = command(commands, "profiles", "find, look at, check and begin profiles", _EXAMPLES)
    width = max(map(len, WHAT)) + 2
    told = "".join(f"  {what:<{width}}{meaning}\n" for what, meaning in WHAT.items())
    parser.epilog = f"what there is:\n{told}\n{parser.epilog}"
    kinds = ("printer", "material", "quality")
    parser.add_argument("what", nargs="?", metavar="WHAT", choices=(*WHAT, *kinds), default="list")
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="of profiles, or files; a kind may stand before"
    )
    parser.add_argument("--inherits", metavar="NAME", help="for new: the profile that it is like")
    parser.add_argument(
        "-o", "--output", metavar="OUT", type=Path, help="for new a file, for schema a folder"
    )
    parser.add_argument("--markdown", action="store_true", help="for settings: as tables of a document")
    add_settings(parser)
    output(parser)
    add_import(parser)
    parser.set_defaults(run=later("profiles", "profiles_command"))
