"""Too little and too much plastic, layer by layer: E read in the wrong way, what does not come out, what is missing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.gcode.lexer import parse
from printer_slicer.inspection.coverage.extrusions import beads_of
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.inspection.dry_run.causes import layer_of
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile

__all__ = ["Feeding", "clogged", "misread", "short_of"]

_LOST: Final = 0.5  # of the length along which filament is pushed that at least gets beads
_SWINGS: Final = 0.05  # of that length: where E goes back so far, it does so bead by bead
_ENOUGH: Final = 50.0  # mm before layers are judged by what they look like
_FAT: Final = 3.0  # mm²; no nozzle lays beads like that
_THIN: Final = 0.4  # of the beads before
_SUDDEN: Final = 0.5  # of those of the layer before
_BEFORE, _AFTER = 5, 3  # layers to compare with, and that at least are thin
_LACKS: Final = 0.9  # of what the part wants
_ALL: Final = 1 << 30  # all layers to come
_LITTLE: Final = 0.5  # mm³ that a layer may lack


class Feeding(NamedTuple):
    """A fault of feeding.

    Attributes:
        command: at which it is told, from 0.
        since: command from which on things follow from it.
        shows: command at which there is no doubt: what is wrong by then may be its cause.
        last: the last layer with it.
        fault: in words.
    """

    command: int
    since: int
    shows: int
    last: int
    fault: Diagnostic


def misread(job: Job, account: Deposition) -> Iterator[Feeding]:
    """Stretches in which E is read as a total and is none, or the other way round."""
    for run in _runs(account.layers, lambda one: one.empty > _LOST * (one.length + one.empty)):
        pushed = sum(one.length + one.empty for one in run)
        wrong = next((one.wrong for one in run if one.wrong is not None), 0) - 1
        if pushed > _ENOUGH and wrong >= 0:
            back = sum(one.back for one in run)
            yield _backward(job, account, (run[0].first - 1, wrong), run[-1].number, back / pushed)
            break
    else:
        vain = account.drought
        if vain is not None and vain.pushed > _ENOUGH:
            yield _backward(job, account, (vain.wrong - 1, vain.wrong - 1), _ALL, vain.back / vain.pushed)
    for run in _runs(
        account.layers, lambda one: one.number > 0 and one.middle > _FAT and one.length > _ENOUGH
    ):
        first = run[0].first - 1
        mode = _mode(job, b"M83", b"M82", first)
        what = f"beads of {run[0].middle:.3g} mm2: E is a total, but read as what each move adds"
        remedy = "put M82 at the start, or M83 in the slicer" if mode is None else "it has to be M82"
        at = first if mode is None else mode
        yield Feeding(
            at, min(first, at), first, run[-1].number, Diagnostic("extrusion", "error", what, remedy=remedy)
        )
        return


def _backward(job: Job, account: Deposition, begin: tuple[int, int], last: int, back: float) -> Feeding:
    """E that goes back too often, or too far once.

    Args:
        job: with it.
        account: of its material.
        begin: the first command of the layer, and the first that feeds in vain.
        last: layer.
        back: share of the length of beads on which it goes back.
    """
    since, wrong = begin
    mode = _mode(job, b"M82", b"M83", wrong)
    first = next((one.first for one in account.layers if one.number), 0)
    changed = mode is not None and mode >= first
    if back < _SWINGS and not changed:
        what = "E begins again below what was reached: the filament is pulled back, and nothing comes out"
        fault = Diagnostic("extrusion", "error", what, remedy="is a G92 E0 missing before it?")
        return Feeding(wrong, min(since, wrong), wrong, last, fault)
    what = "the filament goes back and forth as beads are laid: E is what each move adds, but read as a total"
    if mode is None:
        fault = Diagnostic("extrusion", "error", what, remedy="put M83 at the start, or M82 in the slicer")
        return Feeding(wrong, min(since, wrong), wrong, last, fault)
    return Feeding(mode, mode, wrong, last, Diagnostic("extrusion", "error", what, remedy="it has to be M83"))


def short_of(job: Job, profile: Profile, account: Deposition) -> Iterator[Feeding]:
    """Where less plastic comes than before, or than the part wants."""
    if account.layers and account.laid is None:
        what = "nothing is laid in the whole file"
        yield Feeding(
            -1, 0, 0, _ALL, Diagnostic("lack", "warning", what, remedy="does it print? E has been lost")
        )
    drought = account.drought
    if drought is not None and drought.pushed < _ENOUGH:
        what = f"nothing is laid from here on over {drought.length:.0f} mm, up to z {drought.high:.6g} mm"
        fault = Diagnostic(
            "lack",
            "error",
            what,
            remedy="the moves go on as if something were: has E been lost?",
            z=drought.low,
        )
        begin = drought.command - 1
        yield Feeding(begin, begin, drought.shows - 1, layer_of(account, drought.last - 1), fault)
    wanted = _wanted(job, profile)
    some = [one for one in account.layers if one.number]
    if wanted:
        yield from _against(some, wanted)
    else:
        yield from _thinner(job, some)


def clogged(job: Job, profile: Profile, account: Deposition, missing: float) -> Iterator[Feeding]:
    """What was fed and did not come out, and which layers lack it.

    Args:
        job: that was printed.
        profile: with which it was made.
        account: of its material.
        missing: mm of filament.
    """
    if account.lost is None:
        return
    what = f"from here on {missing:.1f} mm of filament were fed and did not come out: a clog, or the spool is empty"
    short = next(_against([one for one in account.layers if one.number], _wanted(job, profile)), None)
    what += f"; {short.fault.message}" if short is not None else ""
    at = account.lost - 1
    yield Feeding(
        at, at, at, _ALL, Diagnostic("clog", "error", what, remedy="clear the nozzle, look at the spool")
    )


def _runs(
    layers: Sequence[LayerDeposition], wrong: Callable[[LayerDeposition], bool]
) -> Iterator[list[LayerDeposition]]:
    """Layers behind each other with something wrong."""
    some = [one for one in layers if one.length + one.empty > 0]
    for is_wrong, run in groupby(some, wrong):
        if is_wrong:
            yield list(run)


def _mode(job: Job, wrong: bytes, right: bytes, before: int) -> int | None:
    """The command up to one of a job that chose the mode of E, if it is the wrong one."""
    found = _last(job, (wrong, right), 0, before)
    return found if found is not None and parse(job.commands[found])[0] == wrong else None


def _last(job: Job, words: tuple[bytes, ...], since: int, until: int) -> int | None:
    """The last of the commands with one of some codes."""
    return next((at for at in range(until, since - 1, -1) if parse(job.commands[at])[0] in words), None)


def _wanted(job: Job, profile: Profile) -> dict[int, float]:
    """mm³ of beads in each layer of a job that was sliced here; of others nothing."""
    if job.program is None or not job.marks:
        return {}
    beads, kept = beads_of(job.program, profile.material.filament_diameter)
    own = np.unique(job.program.layer, return_inverse=True)[1][kept]
    return dict(enumerate(np.bincount(own, beads.volume).tolist(), 1))


def _against(layers: Sequence[LayerDeposition], wanted: Mapping[int, float]) -> Iterator[Feeding]:
    """Layers that hold less than the part wants."""
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
    what = f"layer {first} holds {short[first]:.0%} of the plastic that the part wants"
    if len(short) > 1:
        what = f"{len(short)} layers from {first} to {max(short)} hold less plastic than the part wants"
        what += f", layer {worst} {short[worst]:.0%} of it"
    fault = Diagnostic("lack", "error", what, remedy="look for M221 and for what the machine kept back")
    # It may begin anywhere in the first of them.
    yield Feeding(begins[0], begins[0], begins[:2][-1], max(short), fault)


def _thinner(job: Job, layers: Sequence[LayerDeposition]) -> Iterator[Feeding]:
    """Beads that are all at once much thinner than those of the layers before, and stay so."""
    some = [one for one in layers if one.thick > 0]
    height = np.diff([one.z for one in some], prepend=0.0)
    section = np.array([one.thick for one in some])
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
            what = f"beads are {section[k] / usual:.0%} as thick as in the layers before, for {_AFTER} layers at least"
            fault = Diagnostic("lack", "error", what, remedy="look for M221, and at E of the lines before it")
            at = begin if flow is None else flow
            yield Feeding(at, at, begin, some[-1].number, fault)
            return
