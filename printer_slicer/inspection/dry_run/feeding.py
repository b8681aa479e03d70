"""Find layers with wrong amounts of material: misread E values, clogs and missing extrusion."""

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

_MAX_EMPTY_SHARE: Final = 0.5  # share of the length with feeding that may extrude nothing
_MIN_RETRACTED_SHARE: Final = 0.05  # share of this length; above it, E decreases with every extrusion
_MIN_LENGTH: Final = 50.0  # mm of extrusion; a layer with less is not checked
_MAX_SECTION: Final = 3.0  # mm²; no nozzle extrudes larger cross-sections
_THIN_RATIO: Final = 0.4  # times the usual cross-section
_SUDDEN_RATIO: Final = 0.5  # times the cross-section in the layer before
_LAYERS_BEFORE, _LAYERS_AFTER = 5, 3  # number of layers to compare with, and of layers that must be thin
_MIN_VOLUME_RATIO: Final = 0.9  # share of the planned volume of a layer
_ALL_LAYERS: Final = 1 << 30  # last layer of a fault that affects all later layers
_MIN_VOLUME_LOSS: Final = 0.5  # mm³ that may be missing in a layer


class ExtrusionFault(NamedTuple):
    """A fault in the amount of extruded material.

    Attributes:
        command: index of the command at which it is reported, from 0.
        since: first command at which a consequence is possible.
        proven_at: command at which it became certain; an earlier fault may be its cause.
        last: the last affected layer.
        fault: the diagnostic.
    """

    command: int
    since: int
    proven_at: int
    last: int
    fault: Diagnostic


def find_misread_e(job: Job, deposition: Deposition) -> Iterator[ExtrusionFault]:
    """Find layers in which absolute E values are read as relative, or relative ones as absolute."""
    for run in _find_runs(
        deposition.layers, lambda one: one.empty_length > _MAX_EMPTY_SHARE * (one.length + one.empty_length)
    ):
        fed_length = sum(one.length + one.empty_length for one in run)
        first_empty = next((one.first_empty for one in run if one.first_empty is not None), 0) - 1
        if fed_length > _MIN_LENGTH and first_empty >= 0:
            retracted = sum(one.retracted_length for one in run)
            yield _decreasing_e_fault(
                job, deposition, (run[0].first - 1, first_empty), run[-1].number, retracted / fed_length
            )
            break
    else:
        gap = deposition.missing_extrusion
        if gap is not None and gap.empty_length > _MIN_LENGTH:
            yield _decreasing_e_fault(
                job,
                deposition,
                (gap.first_empty - 1, gap.first_empty - 1),
                _ALL_LAYERS,
                gap.retracted_length / gap.empty_length,
            )
    for run in _find_runs(
        deposition.layers,
        lambda one: one.number > 0 and one.median_section > _MAX_SECTION and one.length > _MIN_LENGTH,
    ):
        first = run[0].first - 1
        mode_command = _find_wrong_mode(job, b"M83", b"M82", first)
        what = f"extrusions of {run[0].median_section:.3g} mm² cross-section: absolute E values are read as relative"
        remedy = "Add M82 at the start, or use relative extrusion" if mode_command is None else "Use M82 here"
        at = first if mode_command is None else mode_command
        yield ExtrusionFault(
            at, min(first, at), first, run[-1].number, Diagnostic("extrusion", "error", what, remedy=remedy)
        )
        return


def _decreasing_e_fault(
    job: Job, deposition: Deposition, begin: tuple[int, int], last: int, retracted_share: float
) -> ExtrusionFault:
    """Return the fault for E values that decrease too often, or that decrease once by too much.

    Args:
        job: the job.
        deposition: its recorded extrusion.
        begin: the first command of the layer, and the first that feeds without extruding.
        last: the last affected layer.
        retracted_share: share of the length on which E decreases.
    """
    since, first_empty = begin
    mode_command = _find_wrong_mode(job, b"M82", b"M83", first_empty)
    first = next((one.first for one in deposition.layers if one.number), 0)
    changed = mode_command is not None and mode_command >= first
    if retracted_share < _MIN_RETRACTED_SHARE and not changed:
        what = "E restarts below its last value: the filament is retracted, and nothing comes out"
        fault = Diagnostic("extrusion", "error", what, remedy="Check for a missing G92 E0 before this line")
        return ExtrusionFault(first_empty, min(since, first_empty), first_empty, last, fault)
    what = "the filament moves back and forth: relative E values are read as absolute"
    if mode_command is None:
        fault = Diagnostic(
            "extrusion", "error", what, remedy="Add M83 at the start, or use absolute extrusion"
        )
        return ExtrusionFault(first_empty, min(since, first_empty), first_empty, last, fault)
    return ExtrusionFault(
        mode_command,
        mode_command,
        first_empty,
        last,
        Diagnostic("extrusion", "error", what, remedy="Use M83 here"),
    )


def find_missing_material(job: Job, profile: Profile, deposition: Deposition) -> Iterator[ExtrusionFault]:
    """Find layers with less material than the layers before them, or less than the part needs."""
    if deposition.layers and deposition.first_extrusion is None:
        what = "the file extrudes nothing"
        fault = Diagnostic("lack", "warning", what, remedy="Check that its moves have E values")
        yield ExtrusionFault(-1, 0, 0, _ALL_LAYERS, fault)
    missing = deposition.missing_extrusion
    if missing is not None and missing.empty_length < _MIN_LENGTH:
        what = f"nothing is extruded over the next {missing.length:.0f} mm of moves, up to z {missing.high:.6g} mm"
        fault = Diagnostic("lack", "error", what, remedy="Check for missing E values", z=missing.low)
        begin = missing.command - 1
        yield ExtrusionFault(
            begin, begin, missing.proven_at - 1, layer_of(deposition, missing.last - 1), fault
        )
    planned = _planned_volumes(job, profile)
    numbered = [one for one in deposition.layers if one.number]
    if planned:
        yield from _find_layers_lacking_material(numbered, planned)
    else:
        yield from _find_thinning(job, numbered)


def find_clog(job: Job, profile: Profile, deposition: Deposition, missing: float) -> Iterator[ExtrusionFault]:
    """Find filament that was fed but did not come out, and the affected layers.

    Args:
        job: the printed job.
        profile: the profile that it was made with.
        deposition: its recorded extrusion.
        missing: length of the filament that did not come out, mm.
    """
    if deposition.first_missing is None:
        return
    what = f"from here on {missing:.1f} mm of filament were fed but did not come out (clog or empty spool)"
    short = next(
        _find_layers_lacking_material(
            [one for one in deposition.layers if one.number], _planned_volumes(job, profile)
        ),
        None,
    )
    what += f"; {short.fault.message}" if short is not None else ""
    at = deposition.first_missing - 1
    yield ExtrusionFault(
        at,
        at,
        at,
        _ALL_LAYERS,
        Diagnostic("clog", "error", what, remedy="Clear the nozzle and check the spool"),
    )


def _find_runs(
    layers: Sequence[LayerDeposition], is_faulty: Callable[[LayerDeposition], bool]
) -> Iterator[list[LayerDeposition]]:
    """Yield each run of consecutive layers for which `is_faulty` returns True."""
    used = [one for one in layers if one.length + one.empty_length > 0]
    for faulty, run in groupby(used, is_faulty):
        if faulty:
            yield list(run)


def _find_wrong_mode(job: Job, wrong: bytes, right: bytes, before: int) -> int | None:
    """Return the index of the last M82 or M83 up to a command if this is the wrong mode; else None."""
    found = _find_last(job, (wrong, right), 0, before)
    return found if found is not None and parse(job.commands[found])[0] == wrong else None


def _find_last(job: Job, codes: tuple[bytes, ...], first: int, last: int) -> int | None:
    """Return the index of the last command in a range that has one of the codes; None without one."""
    return next((at for at in range(last, first - 1, -1) if parse(job.commands[at])[0] in codes), None)


def _planned_volumes(job: Job, profile: Profile) -> dict[int, float]:
    """Return the planned volume of each layer, mm³, of a job that this program sliced; empty for others."""
    if job.program is None or not job.marks:
        return {}
    beads, kept = extrusions_of_program(job.program, profile.material.filament_diameter)
    layer_index = np.unique(job.program.layer, return_inverse=True)[1][kept]
    return dict(enumerate(np.bincount(layer_index, beads.volume).tolist(), 1))


def _find_layers_lacking_material(
    layers: Sequence[LayerDeposition], planned: Mapping[int, float]
) -> Iterator[ExtrusionFault]:
    """Find layers with less material than planned; report the first of them."""
    volume = {one.number: one.volume for one in layers}
    short = {
        number: volume.get(number, 0.0) / volume_planned
        for number, volume_planned in planned.items()
        if volume.get(number, 0.0)
        < min(_MIN_VOLUME_RATIO * volume_planned, volume_planned - _MIN_VOLUME_LOSS)
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
    # The first of these layers may lose material from its start or only later.
    yield ExtrusionFault(begins[0], begins[0], begins[:2][-1], max(short), fault)


def _find_thinning(job: Job, layers: Sequence[LayerDeposition]) -> Iterator[ExtrusionFault]:
    """Find the layer from which extrusions are suddenly much thinner than before."""
    some = [one for one in layers if one.thick_section > 0]
    height = np.diff([one.z for one in some], prepend=0.0)
    section = np.array([one.thick_section for one in some])
    width = np.where(height > 0, section / np.maximum(height, 1e-6), np.inf)
    for k in range(_LAYERS_BEFORE, len(some) - _LAYERS_AFTER + 1):
        if section[k] >= _SUDDEN_RATIO * section[k - 1]:
            continue
        after = slice(k, k + _LAYERS_AFTER)
        before = slice(k - _LAYERS_BEFORE, k)
        usual, broad = np.median(section[before]), np.median(width[before])
        if (section[after] < _THIN_RATIO * usual).all() and (width[after] < _THIN_RATIO * broad).all():
            begin = some[k].first - 1
            flow = _find_last(job, (b"M221",), some[k - 1].first - 1, begin)
            what = f"extrusions have {section[k] / usual:.0%} of the cross-section of the layers before"
            what += f", for at least {_LAYERS_AFTER} layers"
            fault = Diagnostic("lack", "error", what, remedy="Look for M221, and check E of the lines before")
            at = begin if flow is None else flow
            yield ExtrusionFault(at, at, begin, some[-1].number, fault)
            return
