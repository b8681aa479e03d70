"""`dry-run`, `print` and `sim`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.common import (
    check_writable,
    profile_facts,
    profile_from,
    refuse_same,
    say,
    stages,
    write_file,
)
from printer_slicer.cli.model_flags import refuse_model_flags
from printer_slicer.cli.policy import (
    finding_facts,
    insist_on_policy,
    insist_verified,
    reason_against,
    refused,
)
from printer_slicer.cli.progress import progress
from printer_slicer.cli.simulating import (
    faults_of,
    firmware_of,
    planted_facts,
    planted_lines,
    serve_printer,
    violation_lines,
)
from printer_slicer.cli.verdicts import verdict_facts, verdict_text
from printer_slicer.durations import spoken
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.inspection.lint.lint_jobs import lint_file
from printer_slicer.jobs import Job, is_gcode
from printer_slicer.progress import quiet

if TYPE_CHECKING:
    from printer_slicer.cli.common import Stages
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.printing import Done
    from printer_slicer.profile import Profile
    from printer_slicer.sim.faults import Faults

__all__ = ["dry_run_command", "print_command", "print_with", "sim_command"]

_SIMULATED = "sim:"


def dry_run_command(arguments: argparse.Namespace) -> int:
    """Print on the simulated printer and say what would happen."""
    faults = faults_of(arguments)
    if arguments.picture:
        from printer_slicer.drawing.canvas import check_picture

        check_picture(arguments.picture)
    profile = profile_from(arguments, **_judged_by(arguments))
    with stages(arguments) as report:
        job, known = _job(arguments, profile, report)
    job = job.allowing(arguments.allow)
    verdict = _simulate(arguments, job, profile, events=False, baud=arguments.link, faults=faults)
    if arguments.picture:
        write_file(arguments.picture, _picture(verdict, profile, arguments.picture))
    if arguments.json:
        findings = {"ok": verdict.ok and not refused(job), "findings": finding_facts(job)}
        repairs = {"repairs": _repair_facts(job)}
        facts = verdict_facts(verdict, job, profile) | findings | repairs | known | planted_facts(faults)
        facts |= profile_facts(arguments)
        print(json.dumps(facts))
    else:
        told = [verdict_text(arguments, verdict, job, profile), *planted_lines(faults), *_repaired(job)]
        say(arguments, "\n".join(told))
    _insist(verdict)
    insist_verified(job)
    return 0


def print_command(arguments: argparse.Namespace) -> int:
    """Print over a port; `sim:` is the simulated printer in this process."""
    profile = profile_from(arguments, **_judged_by(arguments))
    with stages(arguments) as report:
        job, known = _job(arguments, profile, report)
    if arguments.json and known["models"]:
        print(json.dumps({"event": "models", **known}), flush=True)
    if arguments.json:
        print(json.dumps({"event": "profile", **profile_facts(arguments)}), flush=True)
    plan = f"{job.plan.n_layers} layers, " if job.plan else ""
    first = f"{job.name}: {plan}{len(job.commands)} commands, {spoken(job.seconds)} of motion"
    say(arguments, "\n  ".join([first, *_repaired(job)]))
    if arguments.json and job.repairs is not None and job.repairs.count:
        print(json.dumps({"event": "repaired", "repairs": _repair_facts(job)}), flush=True)
    job = insist_on_policy(arguments, job)
    if arguments.port == _SIMULATED:
        verdict = _simulate(arguments, job, profile, events=True)
        if arguments.json:
            facts = verdict_facts(verdict, job, profile) | {"repairs": _repair_facts(job)}
            print(json.dumps({"event": "verdict", **facts}))
        else:
            say(arguments, verdict_text(arguments, verdict, job, profile))
        _insist(verdict)
        return 0
    return _print_on_port(arguments, job, profile)


def _has_gcode(arguments: argparse.Namespace) -> bool:
    """Whether G-code is given, not models."""
    return any(map(is_gcode, arguments.models))


def _judged_by(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return arguments for `profile_from`: G-code is judged by its own machine and material, a part by all three."""
    return {
        "slices": bool(arguments.models) and not _has_gcode(arguments),
        "gcode": arguments.models[0] if _has_gcode(arguments) else None,
    }


def _job(arguments: argparse.Namespace, profile: Profile, report: Stages) -> tuple[Job, dict[str, Any]]:
    """The job that the files of the command line make, and what is known about models, for JSON."""
    if _has_gcode(arguments):
        refuse_model_flags(arguments)
        report("reading")
        return lint_file(arguments.models[0], profile), {"models": [], "warnings": []}
    from printer_slicer.cli.models import plate_from, plate_name
    from printer_slicer.cli.projects import with_projects
    from printer_slicer.slice_jobs import job_of

    report("loading")
    mesh, plate = plate_from(arguments, profile.printer, report)
    profile, plate = with_projects(arguments, profile, mesh, plate)
    name = plate_name(arguments.models)
    job = job_of(mesh, profile, name=name, placement=plate.placement, report=report, strict=arguments.strict)
    return job, plate.facts()


def _print_on_port(arguments: argparse.Namespace, job: Job, profile: Profile) -> int:
    from printer_slicer.printing import print_job
    from printer_slicer.printing.shelf import default_shelf

    def begin(**common: Any) -> Done:
        """Print from the beginning."""
        return print_job(
            job,
            profile,
            arguments.port,
            shelf=default_shelf(),
            discard=arguments.discard_unfinished,
            allow=reason_against(profile, job.allowed),
            dtr={"on": True, "off": False}.get(arguments.dtr),
            **common,
        )

    return print_with(arguments, job, Path(f"{arguments.models[0].stem}.checkpoint.json"), begin)


def print_with(arguments: argparse.Namespace, job: Job, checkpoint: Path, begin: Callable[..., Done]) -> int:
    """Print with progress and keys, and say how it ended.

    Args:
        arguments: the command line.
        job: what is printed.
        checkpoint: where to write how far it came.
        begin: prints; is given what `print_job` and `resume_print` have in common.

    Raises:
        VerificationError: the printer is not where the job ends.
    """
    from printer_slicer.cli.keys import keys
    from printer_slicer.printing import Controls

    controls = Controls()
    with (
        progress(arguments, job, events=True, shares=True) as tell,
        keys(controls, wanted=not arguments.quiet),
    ):
        done = begin(
            on_event=tell,
            checkpoint=checkpoint,
            controls=controls,
            reconnect=arguments.reconnect,
            guard=arguments.guard,
        )
    position = {True: "the printer is where the job ends", False: "the printer is NOT where the job ends"}
    if arguments.json:
        print(json.dumps({"event": "finished", **asdict(done)}))
    else:
        known = f"; {position[done.verified]}" if done.verified is not None else ""
        say(
            arguments, f"done: {done.commands} commands in {spoken(done.seconds)}{known}\n  link: {done.link}"
        )
    if done.link.warning is not None and not arguments.json:
        print(f"warning: {done.link.warning.text}", file=sys.stderr)
    if done.verified is False:
        raise VerificationError(
            f"{job.name}: the printer took every command, but it is not where the job ends",
            remedy="look at the part: lines were lost on the cable, or led beyond where the printer moves",
        )
    return 0


def _simulate(
    arguments: argparse.Namespace,
    job: Job,
    profile: Profile,
    *,
    events: bool,
    baud: int | None = None,
    faults: Faults | None = None,
) -> Verdict:
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


def _picture(verdict: Verdict, profile: Profile, path: Path) -> bytes:
    from printer_slicer.diagnostics import sentence
    from printer_slicer.drawing.canvas import picture_bytes
    from printer_slicer.drawing.rehearsal import Mark, rehearsal_picture

    assert verdict.account is not None
    found = [Mark(sentence(fault), fault.z, fault.place) for fault in verdict.faults if fault.is_error]
    title = f"{verdict.job}: {'prints as it should' if verdict.ok else 'do NOT print it'}"
    return picture_bytes(
        rehearsal_picture(verdict.account, found, title, profile.printer.corners, profile.max_flow),
        path,
    )


def _insist(verdict: Verdict) -> None:
    if not verdict.ok:
        more = f"\n  and {len(verdict.problems) - 1} more problems" if len(verdict.problems) > 1 else ""
        raise VerificationError(f"{verdict.job}: {verdict.problems[0]}{more}")


def _repair_facts(job: Job) -> list[dict[str, Any]]:
    """What was put right in the part; what tells it is loaded only then."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_facts

    return repair_facts(job.repairs)


def _repaired(job: Job) -> list[str]:
    """The same for people."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_sentences

    return repair_sentences(_repair_facts(job))


def sim_command(arguments: argparse.Namespace) -> int:
    """Serve the simulated printer on a pseudo-terminal or over TCP until interrupted."""
    from printer_slicer.inspection.dry_run.comparison import Comparison
    from printer_slicer.inspection.dry_run.judging import judge
    from printer_slicer.inspection.dry_run.runner import layer_counter

    _look_at_sim_flags(arguments)
    faults = faults_of(arguments)
    profile = profile_from(arguments, **_judged_by(arguments), tell=False)
    job, known = _job(arguments, profile, quiet) if arguments.models else (None, {})
    comparison = Comparison(job.commands if job else ())
    if faults and job:
        faults.layer_now = layer_counter(job, comparison)
    report = serve_printer(arguments, profile, comparison, faults)
    result = {
        **asdict(report),
        "violations": [list(violation) for violation in report.violations],
        "print_seconds": report.print_seconds,
        "job_commands": comparison.executed,
        "job_digest": comparison.digest,
        **known,
        **planted_facts(faults),
        **profile_facts(arguments),
    }
    verdict = judge(job, profile, report, comparison) if job else None
    if verdict and job:
        result["verdict"] = verdict_facts(verdict, job, profile) | {"repairs": _repair_facts(job)}
    if arguments.report:
        write_file(arguments.report, (json.dumps(result) + "\n").encode())
    if arguments.json:
        print(json.dumps(result))
    elif verdict and job:
        text = verdict_text(arguments, verdict, job, profile)
        say(arguments, "\n".join([text, *planted_lines(faults)]))
    else:
        motion = f"{spoken(report.print_seconds)} of motion, {report.n_violations} violations"
        first = f"executed {comparison.executed} commands, plastic at {len(report.layers)} heights, {motion}"
        say(arguments, "\n".join([first, *violation_lines(report), *planted_lines(faults)]))
    if verdict:
        _insist(verdict)
    return 0


def _look_at_sim_flags(arguments: argparse.Namespace) -> None:
    """Refuse flags that do not go together."""
    if arguments.report and arguments.json and str(arguments.report) == "-":
        raise UsageError("--report - and --json both want stdout", remedy="leave one of them out")
    if arguments.rfc2217 and arguments.tcp is None:
        raise UsageError("--rfc2217 without --tcp", remedy="say with --tcp HOST:PORT where to listen")
    if arguments.report:
        check_writable(arguments.report)
        for path in arguments.models:
            refuse_same(arguments.report, path, "--report")
