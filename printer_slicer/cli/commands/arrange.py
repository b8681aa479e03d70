"""`arrange`: arrange models on plates, and write them as 3MF files."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_layer_options,
    add_model_options,
    add_output_options,
    add_setting_options,
)
from printer_slicer.cli.opening import add_open_option, open_files
from printer_slicer.cli.output import (
    append_to_stem,
    print_text,
    reject_overwriting_input,
    show_stages,
    warn,
    write_file,
)
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import UsageError
from printer_slicer.saving import check_writable

if TYPE_CHECKING:
    from printer_slicer.cli.arrange_models import ArrangedPlates
    from printer_slicer.mesh_io.three_mf_writing import BuildItem

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer arrange box.3mf 'lid.stl*12' -o plate.3mf
  printer-slicer arrange lid.stl box.3mf -o plate.3mf --gap 3 --printer prusa_mk4"""
_SUFFIX: Final = ".3mf"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `arrange`."""
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT.3mf",
        type=Path,
        required=True,
        help="3MF file to write; several plates get numbers",
    )
    add_setting_options(parser, strict_help=STRICT_HELP)
    add_model_options(parser, always_arranges=True)
    group = add_output_options(parser)
    add_open_option(group)
    add_layer_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Arrange models, and write a 3MF file for each plate."""
    from printer_slicer.cli.models import load_arranged_plates
    from printer_slicer.mesh_io.three_mf_writing import make_three_mf

    _check_options(arguments)
    profile = load_selected_profile(arguments, slices=False)
    with show_stages(arguments) as report:
        report("loading")
        arranged, plate = load_arranged_plates(arguments, profile, report)
        if arguments.strict:
            _require_no_repairs(arranged)
        report("writing")
        numbers = range(1, len(arranged.meshes) + 1) if arguments.plate is None else [arguments.plate]
        outputs = {
            number: append_to_stem(arguments.output, f"-{number}" if len(numbers) > 1 else "")
            for number in numbers
        }
        for number, output in outputs.items():
            for path in dict.fromkeys(arguments.models):
                reject_overwriting_input(output, path)
            write_file(output, make_three_mf(list(_list_items(arranged, number - 1))))
    lost = _list_lost_volumes(arranged)
    warn(arguments, lost)
    files = [str(output) for output in outputs.values()]
    if arguments.json:
        facts = plate.collect_facts() | {"warnings": [*plate.warnings, *lost], "outputs": files}
        print(json.dumps(facts | collect_profile_facts(arguments)))
    else:
        print_text(arguments, f"{', '.join(files)}: {arranged.describe()}")
    open_files(arguments, list(outputs.values()))
    return 0


def _check_options(arguments: argparse.Namespace) -> None:
    """Check the output file, and reject options for positions.

    Raises:
        UsageError: the output has another suffix, or a position is given.
        OutputError: the output cannot be written.
    """
    if arguments.output.suffix.lower() != _SUFFIX:
        raise UsageError(
            f"-o {arguments.output}: the name must end in {_SUFFIX}",
            remedy=f"Name it {arguments.output.stem}{_SUFFIX}",
        )
    for flag, is_given in (("--center", arguments.center is not None), ("--as-placed", arguments.as_placed)):
        if is_given:
            raise UsageError(f"{flag}: the command arrange chooses the positions", remedy=f"Leave out {flag}")
    check_writable(arguments.output)
    arguments.arrange = True


def _require_no_repairs(arranged: ArrangedPlates) -> None:
    """Check that no part needs repair, for --strict.

    Raises:
        MeshError: a part does.
    """
    from printer_slicer.healing import repair, require_no_repair

    for mesh in {id(one): one for one in arranged.shapes}.values():
        require_no_repair(mesh.name, repair(mesh)[1])


def _list_items(arranged: ArrangedPlates, plate: int) -> Iterator[BuildItem]:
    """Yield the items of a plate."""
    import numpy as np

    from printer_slicer.mesh_io.three_mf_writing import BuildItem
    from printer_slicer.plates import find_motion

    for part in np.flatnonzero(arranged.places.plate == plate).tolist():
        rotation, shift = find_motion(
            arranged.shapes[part], arranged.places, part, drop=arranged.placement.drop
        )
        yield BuildItem(arranged.shapes[part], rotation, shift)


def _list_lost_volumes(arranged: ArrangedPlates) -> list[str]:
    """Return a warning for each mesh with volumes, which are not written."""
    names = dict.fromkeys(mesh.name for mesh in arranged.shapes if mesh.all_volumes)
    return [f"{name}: modifiers, support volumes and painted facets are not written" for name in names]
