"""Faults planted in a good file: each is found, once, at its line, in its layer, and nothing else is called wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from, job_of
from tests.parts import box

PROFILE = load_profile(
    "marlin_220",
    "pla",
    "standard",
    {"planner.kind": "uniform", "layer_height": 0.3, "first_layer_height": 0.3, "infill_density": 0.2},
)
Lines = list[str]
Plant = Callable[[Lines], int]
"""Spoils the lines of a file; the number of the line that is to blame."""


@cache
def sound(*, relative: bool = True) -> tuple[str, ...]:
    """The lines of a box of twenty layers."""
    profile = (
        PROFILE if relative else load_profile(changes={"relative_extrusion": False, "layer_height": 0.3})
    )
    text = job_of(box((20.0, 20.0, 6.0)), profile).text.decode()
    return tuple(text.split("\n"))


def begin(lines: Lines, layer: int) -> int:
    """Index of the comment with which a layer begins, counted from 1."""
    return [at for at, line in enumerate(lines) if line == ";LAYER_CHANGE"][layer - 1]


def next_line(lines: Lines, at: int, pattern: str) -> int:
    """Index of the first line from `at` on that matches."""
    return next(i for i in range(at, len(lines)) if re.match(pattern, lines[i]))


BEAD = r"G1 [XY].* E\d*\.\d"
"""A line that lays a bead."""


def height(lines: Lines, layer: int) -> float:
    """z of a layer, mm."""
    at = next_line(lines, begin(lines, layer), r";Z:")
    return float(lines[at][3:])


def never_heated(lines: Lines) -> int:
    lines[:] = [line for line in lines if not re.match(r"M10[49] S[1-9]", line)]
    return next_line(lines, 0, r"G1.*E[\d.]")


def cooled_down(lines: Lines) -> int:
    lines.insert(begin(lines, 5) + 1, "M109 R60")
    return next_line(lines, begin(lines, 5), r"G1.*E[\d.]")


def beside_the_bed(lines: Lines) -> int:
    at = next_line(lines, begin(lines, 4), r"G1 X.* E")
    lines[at] = re.sub(r"X\S+", "X321.5", lines[at])
    return at


def too_hot(lines: Lines) -> int:
    lines.insert(begin(lines, 3) + 1, "M104 S400")
    return begin(lines, 3) + 1


def layers_missing(lines: Lines) -> int:
    del lines[begin(lines, 6) : begin(lines, 10)]
    return next_line(lines, begin(lines, 6), BEAD)


def into_the_print(lines: Lines) -> int:
    at = next_line(lines, next_line(lines, begin(lines, 12), ";TYPE:External"), BEAD)
    lines.insert(at, f"G1 Z{height(lines, 12) - 0.45:.3f}")
    lines.insert(at + 2, f"G1 Z{height(lines, 12):.3f}")
    return at + 1


def too_much_at_once(lines: Lines) -> int:
    at = next_line(lines, begin(lines, 7), BEAD)
    lines[at] = re.sub(r"E\S+", "E9", lines[at])
    return at


def m83_lost(lines: Lines) -> int:
    lines[:] = [line for line in lines if line.partition(" ")[0] != "M83"]
    return -1


def m82_lost(lines: Lines) -> int:
    lines[:] = ["M83" if line.partition(" ")[0] == "M82" else line for line in lines]
    return -1


def inches(lines: Lines) -> int:
    lines[:] = ["G20" if line.partition(" ")[0] == "G21" else line for line in lines]
    return -1


def never_homed(lines: Lines) -> int:
    lines[:] = [line for line in lines if line.partition(" ")[0] != "G28"]
    return next_line(lines, 0, r"G1 .*[XY]")  # a lift before it is harmless


def left_on(lines: Lines) -> int:
    lines[:] = [line for line in lines if line.partition(" ; ")[0].strip() != "M104 S0"]
    return max(at for at, line in enumerate(lines) if re.match(r"M10[49] ", line))


PLANTED: list[tuple[str, Plant, str, int]] = [
    ("cold extrusion: never heated", never_heated, "cold", 0),
    ("cold extrusion: cooled down", cooled_down, "cold", 5),
    ("out of the bed", beside_the_bed, "box", 4),
    ("too hot", too_hot, "temperature", 3),
    ("a layer in the air", layers_missing, "unsupported", 6),
    ("a crash into the print", into_the_print, "crash", 12),
    ("flow over the cap", too_much_at_once, "flow", 7),
    ("M83 lost", m83_lost, "extrusion", 0),
    ("M82 lost", m82_lost, "extrusion", 0),
    ("wrong units", inches, "box", 0),
    ("homing forgotten", never_homed, "homing", 0),
    ("a heater left on", left_on, "heater", 2),
]


def found_in(lines: Lines, folder: Path) -> list[Diagnostic]:
    """What a dry run of these lines calls a fault."""
    path = folder / "planted.gcode"
    path.write_text("\n".join(lines))
    verdict = dry_run(job_from(path, PROFILE), PROFILE)
    faults = [fault for fault in verdict.faults if fault.is_error]
    assert bool(faults) is not verdict.ok
    return faults


@pytest.mark.parametrize("relative", [True, False])
def test_the_file_is_good_before(relative: bool, tmp_path: Path) -> None:
    assert found_in(list(sound(relative=relative)), tmp_path) == []


@pytest.mark.parametrize(
    ("plant", "kind", "layer"), [row[1:] for row in PLANTED], ids=[row[0] for row in PLANTED]
)
def test_a_planted_fault_is_found_at_its_line_and_layer(
    plant: Plant, kind: str, layer: int, tmp_path: Path
) -> None:
    lines = list(sound(relative=plant is not m82_lost))
    blamed = plant(lines)
    faults = found_in(lines, tmp_path)

    assert [fault.code for fault in faults] == [kind]
    if blamed >= 0:
        assert (faults[0].line, faults[0].layer) == (blamed + 1, layer)
    assert faults[0].remedy


def test_commands_of_other_firmwares_are_notes_whatever_stands_behind_them(tmp_path: Path) -> None:
    lines = ["G28", "M1002 gcode_claim_action : 0", "M981 S1 P20000", "M1002 judge_flag x"]
    path = tmp_path / "other.gcode"
    path.write_text("\n".join(lines))

    verdict = dry_run(job_from(path, PROFILE), PROFILE)

    unknown = [fault for fault in verdict.faults if fault.code == "unknown"]
    assert [(fault.line, fault.times, fault.is_error) for fault in unknown] == [(2, 2, False), (3, 1, False)]
