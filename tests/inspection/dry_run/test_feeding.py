"""Plastic that does not come, comes back or lacks: told once, where it begins, and what follows from it not at all."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from random import Random  # noqa: TID251 - one with a seed

import pytest

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.profile import load_profile
from printer_slicer.sim.faults import Fault as Trouble
from printer_slicer.sim.faults import Faults
from printer_slicer.slice_jobs import job_from, job_of
from tests.inspection.dry_run.test_planted_faults import (
    BEAD,
    PROFILE,
    Lines,
    begin,
    found_in,
    next_line,
    sound,
)
from tests.parts import box


def inserted(lines: Lines, layer: int, *new: str) -> Lines:
    """The lines with others before a layer."""
    at = begin(lines, layer)
    return [*lines[:at], *new, *lines[at:]]


def per_layer(lines: Lines) -> Lines:
    """Relative E with G92 E0 in each layer, as other slicers write it; then a lost M83 leaves something of each."""
    return [part for line in lines for part in ((line, "G92 E0") if line == ";LAYER_CHANGE" else (line,))]


def without_layers(lines: Lines) -> Lines:
    """No comments that tell of layers."""
    return [line for line in lines if not line.startswith(";")]


@pytest.mark.parametrize("layer", [2, 10, 20])
@pytest.mark.parametrize("writes", [list, per_layer, without_layers])
def test_m83_lost_from_a_layer_on_is_told_at_the_m82(
    writes: Callable[[Lines], Lines], layer: int, tmp_path: Path
) -> None:
    lines = writes(inserted(list(sound()), layer, "M82"))
    (fault,) = found_in(lines, tmp_path)

    assert fault.code == "extrusion"
    assert lines[fault.line - 1] == "M82"
    assert fault.remedy == "Use M83 here"


@pytest.mark.parametrize("layer", [1, 10, 20])
def test_m82_lost_from_a_layer_on_is_told_at_the_m83(layer: int, tmp_path: Path) -> None:
    lines = inserted(list(sound(relative=False)), layer, "M83")
    faults = found_in(lines, tmp_path)

    assert {fault.code for fault in faults} <= {"extrusion", "flow"}
    at = begin(lines, layer)
    assert lines[at - 1] == "M83"
    assert at <= faults[0].line <= next_line(lines, at, BEAD) + 1


def test_e_that_begins_again_without_g92_is_told_where_it_does(tmp_path: Path) -> None:
    """Absolute E that begins at 0 in each layer; the resets are lost."""
    lines = absolute_per_layer(list(sound()))
    assert found_in(lines, tmp_path) == []

    first = begin(lines, 1)
    lines[first:] = [line for line in lines[first:] if line != "G92 E0"]
    (fault,) = found_in(lines, tmp_path)

    assert (fault.code, fault.layer) == ("extrusion", 2)
    assert "G92 E0" in fault.remedy


def absolute_per_layer(lines: Lines) -> Lines:
    """Relative E as totals that begin with each layer."""
    result, total = [], 0.0
    for line in lines:
        found = re.match(r"(G1 .*E)(-?[\d.]+)(.*)", line)
        if found:
            total += float(found[2])
            result.append(f"{found[1]}{total:.5f}{found[3]}")
            continue
        if line == ";LAYER_CHANGE":
            total = 0.0
            result.append("G92 E0")
        result.append("M82" if line.split(" ")[0] == "M83" else line)
    return result


@pytest.mark.parametrize("until", [16, None])
def test_layers_without_e_are_told_where_they_begin(until: int | None, tmp_path: Path) -> None:
    lines = list(sound())
    first, last = begin(lines, 10), begin(lines, until) if until else len(lines)
    lines[first:last] = [re.sub(r" E[\d.]+", "", line) for line in lines[first:last]]
    (fault,) = found_in(lines, tmp_path)

    assert fault.code == "lack"
    assert begin(lines, 9) < fault.line <= next_line(lines, begin(lines, 10), "G1 X.* Y") + 1


@pytest.mark.parametrize("relative", [True, False])
def test_a_flow_of_a_third_is_told_at_its_m221(relative: bool, tmp_path: Path) -> None:
    lines = inserted(list(sound(relative=relative)), 10, "M221 S30")
    (fault,) = found_in(lines, tmp_path)

    assert (fault.code, lines[fault.line - 1]) == ("lack", "M221 S30")
    assert "30%" in fault.message


def test_a_file_that_lays_nothing_at_all_is_told_so(tmp_path: Path) -> None:
    path = tmp_path / "plot.gcode"
    path.write_text("\n".join(re.sub(r" E-?[\d.]+", "", line) for line in sound()))
    verdict = dry_run(job_from(path, PROFILE), PROFILE)

    assert verdict.ok
    assert any("the file extrudes nothing" in note for note in verdict.notes)


# What follows from something else


def homed(lines: Lines, layer: int) -> Lines:
    """The nozzle goes to the bed before the first bead of a layer, and stays there."""
    at = next_line(lines, begin(lines, layer), BEAD)
    return [*lines[:at], "G28 Z", *lines[at:]]


FOLLOWS: list[tuple[str, Callable[[Lines], Lines], str]] = [
    ("cold in layer 1", lambda lines: inserted(lines, 1, "M109 R30"), "cold"),
    ("cold in layer 9", lambda lines: inserted(lines, 9, "M104 S0", "G4 S600"), "cold"),
    ("inches in layer 1", lambda lines: inserted(lines, 1, "G20"), "box"),
    ("inches in layer 12", lambda lines: inserted(lines, 12, "G20"), "box"),
    (
        "up and down too far",
        lambda lines: inserted(lines, 12, "G91", "G0 Z400", "G0 Z-400", "G90", "M83"),
        "box",
    ),
    ("M83 lost", lambda lines: [line for line in lines if line.split(" ")[0] != "M83"], "extrusion"),
    ("homed in the middle", lambda lines: homed(lines, 12), "crash"),
]


@pytest.mark.parametrize(("spoilt", "kind"), [row[1:] for row in FOLLOWS], ids=[row[0] for row in FOLLOWS])
def test_one_cause_is_one_fault(spoilt: Callable[[Lines], Lines], kind: str, tmp_path: Path) -> None:
    assert [fault.code for fault in found_in(spoilt(list(sound())), tmp_path)] == [kind]


def test_what_is_far_from_a_cause_is_told_all_the_same(tmp_path: Path) -> None:
    lines = inserted(list(sound()), 2, "G0 X400", "G0 X100")
    del lines[begin(lines, 12) : begin(lines, 16)]

    assert [fault.code for fault in found_in(lines, tmp_path)] == ["box", "unsupported"]


# Clogs


def clogged(job: Job, share: float, z: float = 3.0) -> Verdict:
    """What a nozzle that clogs at a height makes of a job."""
    return dry_run(job, PROFILE, faults=Faults([Trouble("clog", share=share, z=z)], Random(1)))


def told(verdict: Verdict) -> list[Diagnostic]:
    """Its faults."""
    return [fault for fault in verdict.faults if fault.is_error]


def test_what_a_clog_kept_back_is_not_in_the_account(tmp_path: Path) -> None:
    path = tmp_path / "box.gcode"
    path.write_text("\n".join(sound()))
    job = job_from(path, PROFILE)
    verdict, good = clogged(job, 1.0), dry_run(job, PROFILE)
    assert verdict.deposition is not None
    assert good.deposition is not None
    (fault,) = told(verdict)

    assert fault.code == "clog"
    assert fault.layer in {
        9,
        10,
    }  # it strikes when the first bead at its height is planned, and those before are laid
    assert f"{verdict.report.filament_missing:.1f} mm" in fault.message
    assert len(verdict.problems) == 1
    assert verdict.deposition.volume == pytest.approx(good.deposition.volume / 2, rel=0.1)


def test_a_known_part_tells_which_layers_lack_plastic() -> None:
    verdict = clogged(job_of(box((20.0, 20.0, 6.0)), PROFILE), 0.6)
    (fault,) = told(verdict)

    assert fault.code == "clog"
    assert "11 layers from 10 to 20 have too little material" in fault.message
    assert "40%" in fault.message


def test_a_machine_that_gives_less_is_held_against_the_part() -> None:
    start = "G28\nM109 S215\nM221 S60"
    profile = load_profile("marlin_220", "pla", "standard", {"printer.start_gcode": start})
    (fault,) = told(dry_run(job_of(box((20.0, 20.0, 6.0)), profile), profile))

    assert (fault.code, fault.layer) == ("lack", 1)
    assert "only 60%" in fault.message
