"""Run a dry run for a command, and format the result as text and JSON."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.cli.jobs import format_notes, list_diagnostic_facts, list_disallowed_errors, list_notes
from printer_slicer.cli.output import sanitize
from printer_slicer.cli.progress import ProgressDisplay
from printer_slicer.diagnostics import as_former_json, format_first_error, sentence
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.jobs import Job
from printer_slicer.texts import format_duration
from printer_slicer.values import as_dict

if TYPE_CHECKING:
    from printer_slicer.diagnostics import Diagnostic
    from printer_slicer.inspection.deposition.record import Deposition
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.profile import Printer, Profile
    from printer_slicer.sim.faults import Faults
    from printer_slicer.sim.simulated_firmware import SimulatedFirmware

__all__ = [
    "collect_verdict_facts",
    "format_injected_faults",
    "format_verdict",
    "list_injected_fault_facts",
    "read_faults",
    "require_printable",
    "select_firmware",
    "simulate_print",
]

_MAX_SHOWN_ERRORS: Final = 20
_SHORTEST_TIME: Final = 0.5  # s; roles that take less time are not shown
_LINE_WIDTH: Final = 100  # characters of a line


def simulate_print(
    arguments: argparse.Namespace,
    job: Job,
    profile: Profile,
    *,
    events: bool,
    baud: int | None = None,
    faults: Faults | None = None,
) -> Verdict:
    """Print the job on the simulated printer that the command line describes, and show the progress."""
    from printer_slicer.inspection.dry_run.runner import dry_run

    chosen = getattr(arguments, "firmware", None)
    firmware = select_firmware(arguments, profile.printer) if chosen else None
    extruders, one_hotend = getattr(arguments, "extruders", None), getattr(arguments, "one_hotend", False)
    with ProgressDisplay(arguments, job, events=events) as tell:
        return dry_run(
            job,
            profile,
            on_event=tell,
            baud=baud,
            firmware=firmware,
            faults=faults,
            extruders=extruders,
            one_hotend=one_hotend,
        )


def select_firmware(arguments: argparse.Namespace, printer: Printer) -> SimulatedFirmware:
    """Return the firmware of --firmware; without this option, a firmware for the printer's G-code flavour."""
    from printer_slicer.inspection.dry_run.machines import simulated_firmware_for
    from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES

    return SIMULATED_FIRMWARES[arguments.firmware] if arguments.firmware else simulated_firmware_for(printer)


def read_faults(arguments: argparse.Namespace) -> Faults | None:
    """Read the fault script of --faults; return None without the option.

    Raises:
        UsageError: the fault script cannot be read or is invalid.
    """
    from random import Random  # noqa: TID251 - seeded, so that a run can be repeated

    from printer_slicer.input_files import read_input
    from printer_slicer.sim.fault_script import read_script
    from printer_slicer.sim.faults import Faults
    from printer_slicer.toml_text import MAX_BYTES

    if arguments.faults is None:
        if arguments.seed is not None:
            raise UsageError(
                "--seed has no effect without --faults", remedy="Name a fault script with --faults FILE.toml"
            )
        return None
    try:
        text = read_input(arguments.faults, MAX_BYTES).decode("utf-8")
    except OSError as error:
        raise UsageError(
            f"{arguments.faults}: the fault script cannot be read: {error.strerror}",
            remedy="Name a TOML file with --faults",
        ) from error
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{arguments.faults}: the fault script is not UTF-8 text", remedy="Name a TOML file with --faults"
        ) from error
    faults, seed = read_script(text, str(arguments.faults))
    chosen = next((one for one in (arguments.seed, seed) if one is not None), 0)
    return Faults(faults, Random(chosen))  # noqa: S311 - nothing secret


def format_injected_faults(faults: Faults | None) -> list[str]:
    """Return the injected faults as lines of text."""
    injected = faults.events if faults else []
    return [f"{'injected':<12}{one.time:.1f} s, line {one.line}: {one.text}" for one in injected]


def list_injected_fault_facts(faults: Faults | None) -> dict[str, Any]:
    """Return the injected faults for JSON."""
    return {"injected_faults": [one._asdict() for one in faults.events]} if faults else {}


def require_printable(verdict: Verdict, job: Job) -> None:
    """Raise an error if the dry run found problems; the number in the message includes all lint errors of the job.

    Raises:
        VerificationError: the print has problems.
    """
    if not verdict.ok:
        raise VerificationError(f"{verdict.job}: {format_first_error(_list_errors(verdict, job))}")


def format_verdict(arguments: argparse.Namespace, verdict: Verdict, job: Job, profile: Profile) -> str:
    """Format the result of a dry run as text: summary, errors, warnings, then facts."""
    from printer_slicer.inspection.dry_run.judging import summarize

    wrong = _list_errors(verdict, job)
    notes = (one for one in _list_faults(verdict, job) if not one.is_error)
    warnings = [f"{'warning':<12}{sanitize(sentence(one))}" for one in notes]
    warnings += format_notes(arguments, job, verdict.faults)
    head = f"{verdict.job}: {summarize(len(wrong), has_warnings=bool(warnings))}"
    lines = [head, *(f"{'error':<12}{sanitize(one)}" for one in wrong[:_MAX_SHOWN_ERRORS])]
    if len(wrong) > _MAX_SHOWN_ERRORS:
        lines.append(f"{'error':<12}... and {len(wrong) - _MAX_SHOWN_ERRORS} more (--json lists all)")
    return "\n".join([*lines, *warnings, *_format_facts(verdict, profile)])


def _list_errors(verdict: Verdict, job: Job) -> list[str]:
    """Return all errors of a dry run as text: its problems, then the lint errors that it did not report."""
    return [*verdict.problems, *map(sentence, _find_other_lint_errors(verdict, job))]


def _list_faults(verdict: Verdict, job: Job) -> list[Diagnostic]:
    """Return the faults of a dry run, without a warning of high flow if lint reports it as an error."""
    is_flow_error = any(one.code == "flow" for one in list_disallowed_errors(job))
    return [one for one in verdict.faults if one.is_error or not (is_flow_error and one.code == "flow")]


def _find_other_lint_errors(verdict: Verdict, job: Job) -> list[Diagnostic]:
    """Return the lint errors that the dry run did not report as faults."""
    kinds = {one.code for one in verdict.faults if one.is_error}
    said = {name: {name} for name in ("box", "temperature", "cold", "homing", "unreadable")}
    said |= {"flow": {"flow", "extrusion"}, "unsupported": {"unsupported"}, "head": {"head", "crash"}}
    return [one for one in list_disallowed_errors(job) if not said.get(one.code, set()) & kinds]


def _format_facts(verdict: Verdict, profile: Profile) -> Iterator[str]:
    """Yield the facts about a print, one per line: time, layers, filament, flow, serial link, extent."""
    report = verdict.report
    facts: dict[str, list[str]] = {"time": [_format_times(verdict)]}
    if verdict.deposition is not None:
        facts["by role"] = _join_wrapped(_format_role_times(verdict.deposition))
        facts["layers"] = [_format_layers(verdict, verdict.deposition)]
    facts["filament"] = [_format_filament(verdict, profile)]
    if verdict.deposition is not None and verdict.deposition.peak is not None:
        facts["flow"] = [_format_flow(verdict.deposition, profile)]
    facts["serial"] = [_format_link(verdict)]
    if report.extrusion_min and report.extrusion_max:
        span = (
            f"{name} {low:.{digits}f} to {high:.{digits}f}"
            for name, digits, low, high in zip(
                "xyz", (1, 1, 2), report.extrusion_min, report.extrusion_max, strict=True
            )
        )
        facts["extent"] = [f"{' '.join(span)} mm"]
    facts["executed"] = [f"{_format_executed(verdict)}; {_format_time_difference(verdict)}"]
    for name, texts in facts.items():
        yield from (f"{name if not nth else '':<12}{text}" for nth, text in enumerate(texts))


def _format_executed(verdict: Verdict) -> str:
    """Format how many commands of the job were executed."""
    if verdict.identical:
        return f"all {verdict.commands} commands, in order"
    return f"{verdict.executed} of {verdict.commands} commands, NOT identical to the file"


def _format_time_difference(verdict: Verdict) -> str:
    """Compare the simulated motion with the estimate that was computed from the commands of the file."""
    ratio = verdict.simulated_seconds / verdict.modelled_seconds - 1 if verdict.modelled_seconds else 0.0
    if abs(ratio) < 0.5e-4:
        return "motion takes as long as estimated from these commands"
    difference = f"{100 * abs(ratio):.3g} % {'more' if ratio > 0 else 'less'}"
    return f"motion takes {difference} time than estimated from these commands"


def _format_times(verdict: Verdict) -> str:
    report = verdict.report
    parts = [f"{format_duration(verdict.simulated_seconds)} of motion with start and end G-code"]
    parts += [f"{format_duration(report.heating_seconds)} of heating"] if report.heating_seconds >= 1 else []
    parts += [f"{format_duration(report.homing_seconds)} of homing"] if report.homing_seconds >= 1 else []
    return f"{format_duration(verdict.total_seconds)} in total: {', '.join(parts)}"


def _format_role_times(deposition: Deposition) -> list[str]:
    """Format the time of each role, the longest first."""
    times = {**deposition.by_role, "Travel": deposition.travel, "Retraction": deposition.extruder}
    ordered = sorted(times.items(), key=lambda one: -one[1])
    return [f"{name} {format_duration(seconds)}" for name, seconds in ordered if seconds >= _SHORTEST_TIME]


def _join_wrapped(words: Sequence[str]) -> list[str]:
    """Join words with commas, in lines of limited length."""
    lines = [""]
    for word in words:
        if lines[-1] and len(lines[-1]) + len(word) > _LINE_WIDTH:
            lines[-1] += ","
            lines.append(word)
        else:
            lines[-1] += f", {word}" if lines[-1] else word
    return lines


def _list_layer_heights(deposition: Deposition) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the height of each layer, mm, bottom to top."""
    z = np.unique([round(layer.z, 3) for layer in deposition.layers if layer.number and layer.length > 0])
    return np.diff(z, prepend=0.0)


def _format_layers(verdict: Verdict, deposition: Deposition) -> str:
    heights = _list_layer_heights(deposition)
    if not len(heights):
        return "none"
    printed = sum(bool(layer.number) and layer.length > 0 for layer in deposition.layers)
    # Objects that are printed one after the other have layers at the same heights.
    count = f"{printed} at {len(heights)} heights" if printed > len(heights) else f"{printed}"
    summary = f"{count}, {_format_heights(heights)}; {heights.sum():.6g} mm high"
    if not verdict.heights_equal:
        return f"{summary}; NOT at the heights of the file"
    slowest = max(deposition.layers, key=lambda layer: layer.seconds)
    return f"{summary}; slowest layer {slowest.number} takes {format_duration(slowest.seconds)}"


def _format_heights(heights: np.ndarray[Any, np.dtype[np.float64]]) -> str:
    """Format the height of the first layer, and the range of the others."""
    first, rest = f"first {heights[0]:.3g} mm", heights[1:]
    if not len(rest):
        return first
    low, high = float(rest.min()), float(rest.max())
    return (
        f"{first}, others {low:.3g} mm"
        if high - low < 0.0015
        else f"{first}, others {low:.3g} to {high:.3g} mm"
    )


def _compute_filament_grams(verdict: Verdict, profile: Profile) -> float:
    """Return the mass of the filament that was used, g."""
    area = profile.material.filament_area
    return verdict.report.filament * area / 1000 * profile.material.density


def _format_filament(verdict: Verdict, profile: Profile) -> str:
    grams = _compute_filament_grams(verdict, profile)
    cost = f", cost {grams / 1000 * profile.material.cost:.2f}" if profile.material.cost else ""
    primed = " with priming" if verdict.primed else ""
    return f"{verdict.report.filament / 1000:.2f} m, {grams:.1f} g of {profile.material.name}{primed}{cost}"


def _format_flow(deposition: Deposition, profile: Profile) -> str:
    assert deposition.peak is not None
    laying = sum(deposition.by_role.values())
    mean = deposition.volume / laying if laying else 0.0
    where = f" (layer {deposition.peak.layer}, z {deposition.peak.z:.6g} mm)" if deposition.peak.layer else ""
    return (
        f"at most {deposition.peak.amount:.1f} mm³/s{where}, mean {mean:.1f} mm³/s; "
        f"{profile.material.name} allows {profile.max_flow:g} mm³/s"
    )


def _format_link(verdict: Verdict) -> str:
    """Format whether the serial port was fast enough, and the number of resends."""
    report = verdict.report
    again = f"{report.resends} resends"
    if not verdict.baud:
        return again
    again = f"; {again}" if report.resends else ""
    lost = verdict.simulated_seconds + report.underrun_seconds - verdict.modelled_seconds
    if not report.underruns:
        slower = f"; {lost:.1f} s slower because the motion planner ran short of moves" if lost >= 1 else ""
        return f"{verdict.baud} baud is enough (no buffer underruns){slower}{again}"
    return (
        f"{report.underruns} buffer underruns at {verdict.baud} baud, {report.underrun_seconds:.2f} s of standstill; "
        f"{max(lost, 0):.1f} s lost{again}"
    )


def collect_verdict_facts(verdict: Verdict, job: Job, profile: Profile) -> dict[str, object]:
    """Return the result of a dry run for JSON."""
    report = as_dict(verdict.report)
    report["violations"] = [list(violation) for violation in verdict.report.violations]
    report["halt_reason"] = verdict.report.killed
    report["underrun_list"] = [list(one) for one in verdict.report.underrun_list]
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
        "diagnostics": list_diagnostic_facts(
            job,
            [
                *_list_faults(verdict, job),
                *_find_other_lint_errors(verdict, job),
                *list_notes(job, verdict.faults),
            ],
        ),
        "faults": [as_former_json(fault) for fault in verdict.faults],
        "problems": list(verdict.problems),
        "filament_g": round(_compute_filament_grams(verdict, profile), 3),
        "cost": round(_compute_filament_grams(verdict, profile) / 1000 * profile.material.cost, 4) or None,
        "material": None
        if verdict.deposition is None
        else _collect_material_facts(verdict.deposition, profile),
        "printer": report,
    }


def _collect_material_facts(deposition: Deposition, profile: Profile) -> Mapping[str, object]:
    """Return the extruded material per role and per layer, for JSON; the layer of start G-code is null."""
    peak = deposition.peak
    return {
        "seconds_by_role": {name: round(seconds, 3) for name, seconds in deposition.by_role.items()},
        "travel_seconds": round(deposition.travel, 3),
        "extruder_seconds": round(deposition.extruder, 3),
        "volume_mm3": round(deposition.volume, 3),
        "volume_without_motion_mm3": round(deposition.standing, 3),
        "volume_standing_mm3": round(deposition.standing, 3),
        "layer_heights": np.round(_list_layer_heights(deposition), 4).tolist(),
        "peak_flow": None
        if peak is None
        else {"mm3_per_s": round(peak.amount, 3), "layer": peak.layer or None, "z": round(peak.z, 4)},
        "max_flow": profile.max_flow,
        "layers": [
            {
                "layer": layer.number or None,
                "z": round(layer.z, 4),
                "seconds": round(layer.seconds, 3),
                "volume_mm3": round(layer.volume, 3),
                "peak_flow": round(layer.peak_flow, 3),
                "length_mm": round(layer.length, 2),
            }
            for layer in deposition.layers
        ],
    }
