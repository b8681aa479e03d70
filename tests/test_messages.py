"""Errors that no other test meets, and what all of them have in common: what is wrong, where, and the remedy."""

from __future__ import annotations

import ast
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from printer_slicer import errors
from printer_slicer.cli import main
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.exports.cli_format import write_cli
from printer_slicer.exports.resampling import smooth
from printer_slicer.exports.slc_format import write_slc
from printer_slicer.exports.svg_format import write_svg
from printer_slicer.geometry import Areas
from printer_slicer.geometry.engine import load_engine
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.mesh_io.binary_stl import _read_corners
from printer_slicer.mesh_io.files import open_model_file
from printer_slicer.mesh_io.limits import LIMITS
from printer_slicer.mesh_io.units import check_unit
from printer_slicer.model import LayerPlan, Sections
from printer_slicer.printing.commands import parse_command
from printer_slicer.saving import save
from printer_slicer.stream.framing import check_commands
from tests.parts import box

ROOT: Final = Path(__file__).parents[1]
KINDS: Final = {name for name in errors.__all__ if issubclass(getattr(errors, name), PrinterSlicerError)}


def stack(tops: list[float], at: float = 0.0) -> Sections:
    """A square of 1 mm in every layer."""
    ring = np.array([(at, 0.0), (at + 1, 0), (at + 1, 1), (at, 1)])
    return Sections(LayerPlan.from_tops(np.array(tops)), Areas.from_rings([[ring]] * len(tops)))


CALLS: Final[dict[str, tuple[Callable[[], Any], str, str]]] = {
    "a unit of CLI files": (
        lambda: write_cli(stack([0.2]), binary=False, units_mm=2.0),
        "cannot have units of 2 mm",
        "between 0.000001 and 1 mm",
    ),
    "layers thinner than it": (
        lambda: write_cli(stack([0.2, 0.21]), binary=False, units_mm=0.1),
        "layer 2 is thinner than the CLI unit of 0.1 mm",
        "finer unit",
    ),
    "numbers too large for it": (
        lambda: write_cli(stack([0.2], at=1000.0), binary=True, units_mm=1e-6),
        "with units of 1e-06 mm, it would have to hold 1001000000",
        "coarser unit, or the ASCII variant",
    ),
    "smoothing within nothing": (
        lambda: smooth(stack([0.2]).solid, 0.0),
        "a contour cannot be smoothed within 0 mm",
        "greater than 0",
    ),
    "layers that floats cannot tell apart": (
        lambda: write_slc(stack([1000.0, 1000.00001])),
        "layer 2 is too thin for the 32-bit numbers of SLC",
        "thicker layers",
    ),
    "digits of SVG files": (
        lambda: write_svg(stack([0.2]), digits=9),
        "an SVG cannot have 9 digits after the decimal point",
        "between 0 and 6",
    ),
    "an engine that there is not": (
        lambda: load_engine("cgal"),
        "unknown geometry engine 'cgal' in PRINTER_SLICER_GEOMETRY",
        "clipper",
    ),
    "a unit of length that there is not": (
        lambda: check_unit("yard"),
        "unknown unit 'yard'",
        "inch",
    ),
    "a line break in a command": (
        lambda: check_commands([b"G1 X1", b"G1 X2\nG1 X3"]),
        "line 2 contains a line break or a NUL: 'G1 X2\\nG1 X3'",
        "each command on its own line",
    ),
    "a command that printers cut": (
        lambda: check_commands([b"M117 " + b"x" * 200]),
        "line 1 is 205 bytes long: 'M117 xxx",
        "Shorten the line to",
    ),
    "a command for nothing": (lambda: parse_command(""), "unknown command", "Use one of "),
    "an unknown command": (lambda: parse_command("dance"), "unknown command 'dance'", "pause"),
    "a pause of no kind": (
        lambda: parse_command("pause soon"),
        "unknown option 'soon' of pause",
        "pause [now] [cold] [here]",
    ),
    "a speed that is none": (lambda: parse_command("speed fast"), "fast: expected", "Enter for example 80"),
}


@pytest.mark.parametrize("case", CALLS)
def test_the_message_says_what_and_the_remedy(case: str) -> None:
    call, what, remedy = CALLS[case]

    with pytest.raises(PrinterSlicerError) as raised:
        call()

    assert what in str(raised.value)
    assert remedy in raised.value.remedy


@pytest.mark.parametrize(
    ("typed", "what", "remedy"),
    [
        (
            ["slice", "part.stl", "--set", "perimeters"],
            "--set perimeters: expected KEY=VALUE",
            "infill_density=0.2",
        ),
        (
            ["slice", "part.stl", "--heights", "1:2:3:4"],
            "--heights 1:2:3:4: expected LOW:HIGH",
            "0.1:0.3:0.02",
        ),
        (["slice", "story.txt"], "story.txt: the file is not a model in a supported format", ".stl"),
        (["doctor", "nowhere"], "nowhere: ", ""),
    ],
)
def test_what_is_typed_wrongly_is_told(
    typed: list[str],
    what: str,
    remedy: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    export_stl(box(), tmp_path / "part.stl")
    (tmp_path / "story.txt").write_text("Once upon a time there was a part.\n" * 9)

    assert main(typed) in {2, 4}
    said = capsys.readouterr().err
    assert said.startswith(f"printer-slicer: {what}")
    assert said.count("\n  ") == 1
    assert remedy in said.partition("\n  ")[2]


def test_a_file_that_becomes_shorter_while_it_is_read_is_told(tmp_path: Path) -> None:
    export_stl(box(), tmp_path / "part.stl")

    with (
        open_model_file(tmp_path / "part.stl", LIMITS, lambda _: None) as source,
        pytest.raises(PrinterSlicerError, match=r"part\.stl: the file became shorter while it was read"),
    ):
        _read_corners(source, 13)  # of 12


def test_a_place_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    with pytest.raises(PrinterSlicerError, match="No such file or directory") as raised:
        export_stl(box(), tmp_path / "missing" / "part.stl")
    assert raised.value.remedy

    with pytest.raises(PrinterSlicerError, match="is a folder") as raised:
        save(tmp_path, b"")
    assert raised.value.remedy == "Name a file in this folder"


def test_an_announced_number_of_facets_beyond_all_limits_is_told(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(b"".ljust(80) + struct.pack("<I", 2**32 - 1) + b"\0" * 200)

    with pytest.raises(PrinterSlicerError, match=r"part\.stl") as raised:
        load_mesh(path)
    assert raised.value.remedy


# All of them


@cache
def made_errors() -> list[tuple[str, ast.Call]]:
    """Every place where one of our errors is made."""
    return [
        (f"{path.relative_to(ROOT)}:{node.lineno}", node)
        for path in sorted((ROOT / "printer_slicer").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in KINDS
    ]


# Their messages are made elsewhere, with all there is to say; a cancelled print is what was wished for.
HAVE_THEIR_REMEDY_INSIDE: Final = {"VerificationError", "Cancelled"}


def test_every_error_has_a_remedy() -> None:
    without = [
        f"{place}: {ast.unparse(node)[:80]}"
        for place, node in made_errors()
        if not any(keyword.arg in {"remedy", None} for keyword in node.keywords)
        and isinstance(node.func, ast.Name)
        and node.func.id not in HAVE_THEIR_REMEDY_INSIDE
    ]

    assert len(made_errors()) > 200
    assert without == []


def end_of(message: ast.expr) -> str:
    """The last words of a message that stand in the code."""
    parts = message.values if isinstance(message, ast.JoinedStr) else [message]
    last = parts[-1]
    return str(last.value) if isinstance(last, ast.Constant) else ""


def test_messages_do_not_end_in_full_stops() -> None:
    """`file: what is wrong`, as other programs say it; the remedy is a line of its own."""
    ends = {place: end_of(node.args[0]) for place, node in made_errors() if node.args}

    assert [
        place for place, end in ends.items() if end.endswith((".", "!")) and not end.endswith("...")
    ] == []
