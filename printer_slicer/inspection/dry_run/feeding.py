"""Find wrong amounts of material, layer by layer: E misread, clogs, missing extrusion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.gcode.lexer import parse
from printer_slicer.inspection.coverage.extrusions import extrusions_of_program
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.inspection.dry_run.causes import layer_of
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile

__all__ = ["ExtrusionFault", "find_clog", "find_misread_e", "find_missing_material"]

_LOST: Final = 0.5  # share of the length with filament feed that must extrude
_SWINGS: Final = 0.05  # share of that length; more retraction means that E goes back with every extrusion
_ENOUGH: Final = 50.0  # mm of extrusion needed before a layer is judged
_FAT: Final = 3.0  # mm²; no nozzle extrudes cross-sections like that
_THIN: Final = 0.4  # of the cross-section before
_SUDDEN: Final = 0.5  # of those of the layer before
_BEFORE, _AFTER = 5, 3  # layers to compare with, and that at least are thin
_LACKS: Final = 0.9  # of the planned volume
_ALL: Final = 1 << 30  # all layers to come
_LITTLE: Final = 0.5  # mm³ that a layer may lack


class ExtrusionFault(NamedTuple):
    """A wrong amount of material.

    Attributes:
        command: index of the command at which it is reported, from 0.
        since: command from which on other faults may follow from it.
        proven_at: command at which it became certain; an earlier fault may be its cause.
        last: the last layer with it.
        fault: the diagnostic.
    """

    command: int
    since: int
    proven_at: int
    last: int
    fault: Diagnostic


def find_misread_e(job: Job, deposition: Deposition) -> Iterator[ExtrusionFault]:
    """Find layers in which absolute E is read as relative, or the other way round."""
    for run in _runs(
        deposition.layers, lambda one: one.empty_length > _LOST * (one.length + one.empty_length)
    ):
        pushed = sum(one.length + one.empty_length for one in run)
        wrong = next((one.first_empty for one in run if one.first_empty is not None), 0) - 1
        if pushed > _ENOUGH and wrong >= 0:
            back = sum(one.retracted_length for one in run)
            yield _reversed_e(job, deposition, (run[0].first - 1, wrong), run[-1].number, back / pushed)
            break
    else:
        gap = deposition.missing_extrusion
        if gap is not None and gap.empty_length > _ENOUGH:
            yield _reversed_e(
                job,
                deposition,
                (gap.first_empty - 1, gap.first_empty - 1),
                _ALL,
                gap.retracted_length / gap.empty_length,
            )
    for run in _runs(
        deposition.layers, lambda one: one.number > 0 and one.median_section > _FAT and one.length > _ENOUGH
    ):
        first = run[0].first - 1
        mode = _mode(job, b"M83", b"M82", first)
        what = f"extrusions of {run[0].median_section:.3g} mm² cross-section: absolute E values are read as relative"
        remedy = "Add M82 at the start, or use relative extrusion" if mode is None else "Use M82 here"
        at = first if mode is None else mode
        yield ExtrusionFault(
            at, min(first, at), first, run[-1].number, Diagnostic("extrusion", "error", what, remedy=remedy)
        )
        return


def _reversed_e(
    job: Job, deposition: Deposition, begin: tuple[int, int], last: int, back: float
) -> ExtrusionFault:
    """Report E values that go back too often, or too far once.

    Args:
        job: to search.
        deposition: of its material.
        begin: the first command of the layer, and the first that feeds without extruding.
        last: the last layer with it.
        back: share of the extruded length on which E goes back.
    """
    since, wrong = begin
    mode = _mode(job, b"M82", b"M83", wrong)
    first = next((one.first for one in deposition.layers if one.number), 0)
    changed = mode is not None and mode >= first
    if back < _SWINGS and not changed:
        what = "E restarts below its last value: the filament is retracted, and nothing comes out"
        fault = Diagnostic("extrusion", "error", what, remedy="Check for a missing G92 E0 before this line")
        return ExtrusionFault(wrong, min(since, wrong), wrong, last, fault)
    what = "the filament moves back and forth: relative E values are read as absolute"
    if mode is None:
        fault = Diagnostic(
            "extrusion", "error", what, remedy="Add M83 at the start, or use absolute extrusion"
        )
        return ExtrusionFault(wrong, min(since, wrong), wrong, last, fault)
    return ExtrusionFault(
        mode, mode, wrong, last, Diagnostic("extrusion", "error", what, remedy="Use M83 here")
    )


def find_missing_material(job: Job, profile: Profile, deposition: Deposition) -> Iterator[ExtrusionFault]:
    """Find where less material comes out than before, or than the part needs."""
    if deposition.layers and deposition.first_extrusion is None:
        what = "the file extrudes nothing"
        yield ExtrusionFault(
            -1, 0, 0, _ALL, Diagnostic("lack", "warning", what, remedy="Check that its moves have E values")
        )
    gap = deposition.missing_extrusion
    if gap is not None and gap.empty_length < _ENOUGH:
        what = f"nothing is extruded over the next {gap.length:.0f} mm of moves, up to z {gap.high:.6g} mm"
        fault = Diagnostic(
            "lack",
            "error",
            what,
            remedy="Check for missing E values",
            z=gap.low,
        )
        begin = gap.command - 1
        yield ExtrusionFault(begin, begin, gap.proven_at - 1, layer_of(deposition, gap.last - 1), fault)
    wanted = _wanted(job, profile)
    some = [one for one in deposition.layers if one.number]
    if wanted:
        yield from _find_short_layers(some, wanted)
    else:
        yield from _find_thinning(job, some)


def find_clog(job: Job, profile: Profile, deposition: Deposition, missing: float) -> Iterator[ExtrusionFault]:
    """Report filament that was fed but did not come out, and the affected layers.

    Args:
        job: that was printed.
        profile: with which it was made.
        deposition: of its material.
        missing: mm of filament.
    """
    if deposition.first_missing is None:
        return
    what = f"from here on {missing:.1f} mm of filament were fed but did not come out (clog or empty spool)"
    short = next(
        _find_short_layers([one for one in deposition.layers if one.number], _wanted(job, profile)), None
    )
    what += f"; {short.fault.message}" if short is not None else ""
    at = deposition.first_missing - 1
    yield ExtrusionFault(
        at, at, at, _ALL, Diagnostic("clog", "error", what, remedy="Clear the nozzle and check the spool")
    )


def _runs(
    layers: Sequence[LayerDeposition], wrong: Callable[[LayerDeposition], bool]
) -> Iterator[list[LayerDeposition]]:
    """Yield runs of consecutive layers for which `first_empty` holds."""
    some = [one for one in layers if one.length + one.empty_length > 0]
    for is_wrong, run in groupby(some, wrong):
        if is_wrong:
            yield list(run)


def _mode(job: Job, wrong: bytes, right: bytes, before: int) -> int | None:
    """Return the last M82 or M83 up to a command, if it is the wrong one."""
    found = _last(job, (wrong, right), 0, before)
    return found if found is not None and parse(job.commands[found])[0] == wrong else None


def _last(job: Job, words: tuple[bytes, ...], since: int, until: int) -> int | None:
    """Return the last command with one of the codes."""
    return next((at for at in range(until, since - 1, -1) if parse(job.commands[at])[0] in words), None)


def _wanted(job: Job, profile: Profile) -> dict[int, float]:
    """Return the planned mm³ of each layer of a job that was sliced here; empty for other jobs."""
    if job.program is None or not job.marks:
        return {}
    beads, kept = extrusions_of_program(job.program, profile.material.filament_diameter)
    own = np.unique(job.program.layer, return_inverse=True)[1][kept]
    return dict(enumerate(np.bincount(own, beads.volume).tolist(), 1))


def _find_short_layers(
    layers: Sequence[LayerDeposition], wanted: Mapping[int, float]
) -> Iterator[ExtrusionFault]:
    """Find layers with less material than planned."""
    volume = {one.number: one.volume for one in layers}
    short = {
        number: volume.get(number, 0.0) / want
        for number, want in wanted.items()
        if volume.get(number, 0.0) < min(_LACKS * want, want - _LITTLE)
    }
    if not short:
        return
    worst = min(short, key=lambda number: short[number])
    first = min(short)
    begins = [one.first - 1 for one in layers if one.number >= first] or [0]
    what = f"layer {first} has {short[first]:.0%} of the material that the part needs"
    if len(short) > 1:
        what = f"{len(short)} layers from {first} to {max(short)} have too little material"
        what += f", layer {worst} only {short[worst]:.0%}"
    fault = Diagnostic(
        "lack", "error", what, remedy="Look for M221, and for extrusion that the printer rejected"
    )
    # It may start anywhere in the first of them.
    yield ExtrusionFault(begins[0], begins[0], begins[:2][-1], max(short), fault)


def _find_thinning(job: Job, layers: Sequence[LayerDeposition]) -> Iterator[ExtrusionFault]:
    """Find a layer from which on extrusions are suddenly much thinner than before."""
    some = [one for one in layers if one.thick_section > 0]
    height = np.diff([one.z for one in some], prepend=0.0)
    section = np.array([one.thick_section for one in some])
    width = np.where(height > 0, section / np.maximum(height, 1e-6), np.inf)
    for k in range(_BEFORE, len(some) - _AFTER + 1):
        if section[k] >= _SUDDEN * section[k - 1]:
            continue
        after = slice(k, k + _AFTER)
        before = slice(k - _BEFORE, k)
        usual, broad = np.median(section[before]), np.median(width[before])
        if (section[after] < _THIN * usual).all() and (width[after] < _THIN * broad).all():
            begin = some[k].first - 1
            flow = _last(job, (b"M221",), some[k - 1].first - 1, begin)
            what = f"extrusions have {section[k] / usual:.0%} of the cross-section of the layers before"
            what += f", for at least {_AFTER} layers"
            fault = Diagnostic("lack", "error", what, remedy="Look for M221, and check E of the lines before")
            at = begin if flow is None else flow
            yield ExtrusionFault(at, at, begin, some[-1].number, fault)
            return
