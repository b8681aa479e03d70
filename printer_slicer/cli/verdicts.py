"""Print on the simulated printer, and say what that came to, for people and for programs."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from math import pi
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.cli.jobs import finding_lines, refused_findings
from printer_slicer.cli.output import sanitize
from printer_slicer.cli.progress import progress
from printer_slicer.diagnostics import as_json, sentence
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.jobs import Job
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.inspection.deposition.record import Deposition
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.profile import Printer, Profile
    from printer_slicer.sim.faults import Faults
    from printer_slicer.sim.switches import FrontEnd

__all__ = [
    "faults_of",
    "firmware_of",
    "insist_printable",
    "planted_facts",
    "planted_lines",
    "simulate",
    "verdict_facts",
    "verdict_text",
]

_MOST_FAULTS: Final = 20
_WORTH: Final = 0.5  # s; roles that take less are not worth a word
_WIDE: Final = 100  # characters of a line


def simulate(
    arguments: argparse.Namespace,
    job: Job,
    profile: Profile,
    *,
    events: bool,
    baud: int | None = None,
    faults: Faults | None = None,
) -> Verdict:
    """Print the job on the simulated printer that the command line describes, with progress."""
    from printer_slicer.inspection.dry_run.runner import dry_run

    chosen = getattr(arguments, "firmware", None)
    front_end = firmware_of(arguments, profile.printer) if chosen else None
    extruders, one_hotend = getattr(arguments, "extruders", None), getattr(arguments, "one_hotend", False)
    with progress(arguments, job, events=events) as tell:
        return dry_run(
            job,
            profile,
            on_event=tell,
            baud=baud,
            front_end=front_end,
            faults=faults,
            extruders=extruders,
            one_hotend=one_hotend,
        )


def firmware_of(arguments: argparse.Namespace, printer: Printer) -> FrontEnd:
    """The firmware that was asked for, else the one that understands what the printer's profile writes."""
    from printer_slicer.inspection.dry_run.machines import front_end_of
    from printer_slicer.sim.front_end import FRONT_ENDS

    return FRONT_ENDS[arguments.firmware] if arguments.firmware else front_end_of(printer)


def faults_of(arguments: argparse.Namespace) -> Faults | None:
    """What shall go wrong; None for nothing.

    Raises:
        UsageError: the script cannot be read or makes no sense.
    """
    from random import Random  # noqa: TID251 - seeded, so that a run can be had again

    from printer_slicer.input_files import read_input
    from printer_slicer.sim.fault_script import read_script
    from printer_slicer.sim.faults import Faults
    from printer_slicer.toml_text import MOST_BYTES

    if arguments.faults is None:
        if arguments.seed is not None:
            raise UsageError("--seed without --faults", remedy="say with --faults what shall go wrong")
        return None
    try:
        text = read_input(arguments.faults, MOST_BYTES).decode("utf-8")
    except OSError as error:
        raise UsageError(
            f"{arguments.faults}: {error.strerror}", remedy="--faults wants a TOML file"
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{arguments.faults}: no text in UTF-8", remedy="--faults wants a TOML file"
        ) from error
    faults, seed = read_script(text, str(arguments.faults))
    chosen = next((one for one in (arguments.seed, seed) if one is not None), 0)
    return Faults(faults, Random(chosen))  # noqa: S311 - nothing secret


def planted_lines(faults: Faults | None) -> list[str]:
    """The faults that struck, for people."""
    struck = faults.happened if faults else []
    return [f"{'planted':<12}{one.time:.1f} s, line {one.line}: {one.text}" for one in struck]


def planted_facts(faults: Faults | None) -> dict[str, Any]:
    """The same for programs."""
    return {"planted": [one._asdict() for one in faults.happened]} if faults else {}


def insist_printable(verdict: Verdict) -> None:
    """Fail if the print is not what it should be.

    Raises:
        VerificationError: it is not.
    """
    if not verdict.ok:
        more = f"\n  and {len(verdict.problems) - 1} more problems" if len(verdict.problems) > 1 else ""
        raise VerificationError(f"{verdict.job}: {verdict.problems[0]}{more}")


def verdict_text(arguments: argparse.Namespace, verdict: Verdict, job: Job, profile: Profile) -> str:
    """All of it for people: whether to print it comes first, then what is wrong, then what is worth knowing."""
    wrong = [*verdict.problems, *_unsaid(verdict, job)]
    head = (
        f"{verdict.job}: prints as it should"
        if not wrong
        else f"{verdict.job}: do NOT print it: {_count(wrong)}"
    )
    lines = [head, *(f"{'fault':<12}{sanitize(one)}" for one in wrong[:_MOST_FAULTS])]
    if len(wrong) > _MOST_FAULTS:
        lines.append(f"{'fault':<12}... and {len(wrong) - _MOST_FAULTS} more, which --json lists")
    lines += [f"{'note':<12}{sanitize(one)}" for one in verdict.notes]
    lines += finding_lines(arguments, job)
    return "\n".join([*lines, *_fact_lines(verdict, profile)])


def _unsaid(verdict: Verdict, job: Job) -> list[str]:
    """What is refused and no fault says already: of the same line, or of the same kind where the file is full of it."""
    kinds = {one.code for one in verdict.faults if one.is_error}
    said = {name: {name} for name in ("box", "temperature", "cold", "homing", "unreadable")}
    said |= {"flow": {"flow", "extrusion"}, "unsupported": {"unsupported"}}
    return [sentence(one) for one in refused_findings(job) if not said.get(one.code, set()) & kinds]


def _count(wrong: Sequence[str]) -> str:
    return f"{len(wrong)} fault{'s' if len(wrong) > 1 else ''}"


def _fact_lines(verdict: Verdict, profile: Profile) -> Iterator[str]:
    """What the print is, name by name."""
    report = verdict.report
    facts: dict[str, list[str]] = {"time": [_time(verdict)]}
    if verdict.account is not None:
        facts["by role"] = _wrapped(_roles(verdict.account))
        facts["layers"] = [_layers(verdict, verdict.account)]
    facts["filament"] = [_filament(verdict, profile)]
    if verdict.account is not None and verdict.account.peak is not None:
        facts["flow"] = [_flow(verdict.account, profile)]
    facts["link"] = [_link(verdict)]
    if report.laid_min and report.laid_max:
        span = (
            f"{name} {low:.{digits}f} to {high:.{digits}f}"
            for name, digits, low, high in zip(
                "xyz", (1, 1, 2), report.laid_min, report.laid_max, strict=True
            )
        )
        facts["plastic"] = [f"{' '.join(span)} mm"]
    sent = "as sent" if verdict.identical else "NOT as sent"
    ratio = verdict.simulated_seconds / verdict.modelled_seconds - 1 if verdict.modelled_seconds else 0.0
    facts["executed"] = [
        f"{verdict.executed} of {verdict.commands} commands, {sent}; {ratio:+.2%} of the time that was modelled"
    ]
    for name, texts in facts.items():
        yield from (f"{name if not nth else '':<12}{text}" for nth, text in enumerate(texts))


def _time(verdict: Verdict) -> str:
    report = verdict.report
    parts = [f"{format_duration(report.heating_seconds)} of heating"] if report.heating_seconds >= 1 else []
    parts += [f"{format_duration(report.homing_seconds)} of homing"] if report.homing_seconds >= 1 else []
    more = f", with {' and '.join(parts)}" if parts else ""
    in_all, moving = map(format_duration, (verdict.total_seconds, verdict.simulated_seconds))
    return f"{in_all} in all{more}; {moving} of motion"


def _roles(account: Deposition) -> list[str]:
    """Time by what it is for, the longest first."""
    times = {**account.by_role, "Travel": account.travel, "Retraction": account.extruder}
    ordered = sorted(times.items(), key=lambda one: -one[1])
    return [f"{name} {format_duration(seconds)}" for name, seconds in ordered if seconds >= _WORTH]


def _wrapped(words: Sequence[str]) -> list[str]:
    """Words with commas, in lines that are not too long."""
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + len(word) > _WIDE:
            lines[-1] += ","
            lines.append(word)
        else:
            lines[-1] += f", {word}" if lines[-1] else word
    return lines


def _heights(account: Deposition) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Thickness of each layer, mm, from below."""
    z = np.unique([round(layer.z, 3) for layer in account.layers if layer.number and layer.length > 0])
    return np.diff(z, prepend=0.0)


def _layers(verdict: Verdict, account: Deposition) -> str:
    heights = _heights(account)
    if not len(heights):
        return "none"
    first, rest = float(heights[0]), heights[1:] if len(heights) > 1 else heights
    low, high = float(rest.min()), float(rest.max())
    span = f"{low:.3g} mm" if high - low < 0.0015 else f"{low:.3g} to {high:.3g} mm"
    said = f"{len(heights)}, the first of {first:.3g} mm, the others of {span}; {heights.sum():.6g} mm high"
    if not verdict.heights_equal:
        return f"{said}; NOT at the heights of the job"
    slowest = max(account.layers, key=lambda layer: layer.seconds)
    return f"{said}; the longest takes {format_duration(slowest.seconds)} (layer {slowest.number})"


def _grams(verdict: Verdict, profile: Profile) -> float:
    area = pi * profile.material.filament_diameter**2 / 4
    return verdict.report.filament * area / 1000 * profile.material.density


def _filament(verdict: Verdict, profile: Profile) -> str:
    grams = _grams(verdict, profile)
    cost = f", {grams / 1000 * profile.material.cost:.2f} of money" if profile.material.cost else ""
    return f"{verdict.report.filament / 1000:.2f} m, {grams:.1f} g of {profile.material.name}{cost}"


def _flow(account: Deposition, profile: Profile) -> str:
    assert account.peak is not None
    laying = sum(account.by_role.values())
    mean = account.volume / laying if laying else 0.0
    where = f" (layer {account.peak.layer}, z {account.peak.z:.6g} mm)" if account.peak.layer else ""
    return (
        f"{account.peak.amount:.1f} mm3/s at most{where}, {mean:.1f} in the mean; "
        f"{profile.material.name} melts {profile.max_flow:g}"
    )


def _link(verdict: Verdict) -> str:
    report = verdict.report
    again = f"{report.resends} resends"
    if not verdict.baud:
        return again
    again = f"; {again}" if report.resends else ""
    lost = verdict.simulated_seconds + report.starved_seconds - verdict.modelled_seconds
    if not report.starvations:
        slower = f"; short of moves it is {lost:.1f} s slower" if lost >= 1 else ""
        return f"at {verdict.baud} Bd the machine never runs out of moves{slower}{again}"
    return (
        f"at {verdict.baud} Bd the machine runs out of moves {report.starvations} times and stands still for "
        f"{report.starved_seconds:.2f} s; {max(lost, 0):.1f} s are lost{again}"
    )


def verdict_facts(verdict: Verdict, job: Job, profile: Profile) -> dict[str, object]:
    """All of it for programs."""
    report = asdict(verdict.report)
    report["violations"] = [list(violation) for violation in verdict.report.violations]
    report["starved"] = [list(one) for one in verdict.report.starved]
    return {
        "job": verdict.job,
        "ok": verdict.ok,
        "executed_equals_sent": verdict.identical,
        "commands": verdict.commands,
        "executed": verdict.executed,
        "heights_equal_plan": verdict.heights_equal,
        "heights": list(verdict.heights),
        "planned": job.plan.top.tolist() if job.plan else None,
        "modelled_seconds": round(verdict.modelled_seconds, 3),
        "simulated_seconds": round(verdict.simulated_seconds, 3),
        "total_seconds": round(verdict.total_seconds, 3),
        "baud": verdict.baud,
        "faults": [as_json(fault) for fault in verdict.faults],
        "problems": list(verdict.problems),
        "filament_g": round(_grams(verdict, profile), 3),
        "cost": round(_grams(verdict, profile) / 1000 * profile.material.cost, 4) or None,
        "material": None if verdict.account is None else _material_facts(verdict.account, profile),
        "printer": report,
    }


def _material_facts(account: Deposition, profile: Profile) -> Mapping[str, object]:
    peak = account.peak
    return {
        "seconds_by_role": {name: round(seconds, 3) for name, seconds in account.by_role.items()},
        "travel_seconds": round(account.travel, 3),
        "extruder_seconds": round(account.extruder, 3),
        "volume_mm3": round(account.volume, 3),
        "volume_standing_mm3": round(account.standing, 3),
        "layer_heights": np.round(_heights(account), 4).tolist(),
        "peak_flow": None
        if peak is None
        else {"mm3_per_s": round(peak.amount, 3), "layer": peak.layer, "z": round(peak.z, 4)},
        "max_flow": profile.max_flow,
        "layers": [
            {
                "layer": layer.number,
                "z": round(layer.z, 4),
                "seconds": round(layer.seconds, 3),
                "volume_mm3": round(layer.volume, 3),
                "peak_flow": round(layer.peak_flow, 3),
                "length_mm": round(layer.length, 2),
            }
            for layer in account.layers
        ],
    }
