"""The job that a command line asks for, and what was found in it before it is sent: told, listed, or refused."""

from __future__ import annotations

import argparse
import json
import sys
from collections import deque
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.arguments import refuse_model_flags
from printer_slicer.cli.output import visible
from printer_slicer.diagnostics import Diagnostic, as_json, check_names, insist, remedy_of, sentence
from printer_slicer.errors import VerificationError
from printer_slicer.inspection.lint.scan import lint_file, scan
from printer_slicer.jobs import Job, is_gcode
from printer_slicer.profile import Profile

if TYPE_CHECKING:
    from printer_slicer.cli.output import Stages

__all__ = [
    "finding_facts",
    "finding_lines",
    "finding_notes",
    "insist_on_policy",
    "insist_verified",
    "job_from",
    "judged_by",
    "reason_against",
    "reason_behind",
    "refused",
    "refused_findings",
    "repairs_facts",
    "repairs_lines",
]

_TOLD = 5  # without --verbose
_REMEMBERED = 500  # commands typed before, whose units and modes count


def _has_gcode(arguments: argparse.Namespace) -> bool:
    """Whether G-code is given, not models."""
    return any(map(is_gcode, arguments.models))


def judged_by(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return arguments for `profile_from`: G-code is judged by its own machine and material, a part by all three."""
    return {
        "slices": bool(arguments.models) and not _has_gcode(arguments),
        "gcode": arguments.models[0] if _has_gcode(arguments) else None,
    }


def job_from(arguments: argparse.Namespace, profile: Profile, report: Stages) -> tuple[Job, dict[str, Any]]:
    """The job that the files of the command line make, and what is known about models, for JSON."""
    if _has_gcode(arguments):
        refuse_model_flags(arguments)
        report("reading")
        return lint_file(arguments.models[0], profile), {"models": [], "warnings": []}
    from printer_slicer.cli.models import plate_from, plate_name, with_projects
    from printer_slicer.slice_jobs import job_of

    report("loading")
    mesh, plate = plate_from(arguments, profile.printer, report)
    profile, plate = with_projects(arguments, profile, mesh, plate)
    name = plate_name(arguments.models)
    job = job_of(mesh, profile, name=name, placement=plate.placement, report=report, strict=arguments.strict)
    return job, plate.facts()


def repairs_facts(job: Job) -> list[dict[str, Any]]:
    """What was put right in the part; what tells it is loaded only then."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_facts

    return repair_facts(job.repairs)


def repairs_lines(job: Job) -> list[str]:
    """The same for people."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_sentences

    return repair_sentences(repairs_facts(job))


def insist_on_policy(arguments: argparse.Namespace, job: Job, refusal: str = "not printed") -> Job:
    """Say what is in the job, before its first byte; the job with what is allowed.

    Args:
        arguments: the command line.
        job: with its findings.
        refusal: what does not happen to a refused job, for the message.

    Raises:
        PolicyError: it holds what was not allowed.
        UsageError: a name that was allowed does not exist.
    """
    job = job.allowing(arguments.allow)
    if arguments.json and job.findings:
        print(json.dumps({"event": "findings", "findings": finding_facts(job)}), flush=True)
    if not (arguments.json or arguments.quiet):
        for note in finding_notes(arguments, job):
            print(visible(f"printer-slicer: warning: {note}"), file=sys.stderr)
    insist(job.findings, job.allowed, name=job.name, refusal=refusal)
    return job


def refused(job: Job) -> list[str]:
    """What was found and is not allowed, one sentence each."""
    return [sentence(one) for one in refused_findings(job)]


def refused_findings(job: Job) -> list[Diagnostic]:
    """The same as findings."""
    return [one for one in job.findings if one.is_error and one.code not in job.allowed]


def finding_facts(job: Job) -> list[dict[str, Any]]:
    """All findings, ready for JSON."""
    return [as_json(one) | {"allowed": one.code in job.allowed} for one in job.findings]


def finding_notes(arguments: argparse.Namespace, job: Job) -> list[str]:
    """What was found and does not keep the job from being printed, for people."""
    told = [one for one in job.findings if not one.is_error or one.code in job.allowed]
    most = len(told) if arguments.verbose else _TOLD
    more = [f"... and {len(told) - most} more (-v tells all)"] if len(told) > most else []
    return [*(sentence(one) for one in told[:most]), *more]


def finding_lines(arguments: argparse.Namespace, job: Job) -> list[str]:
    """The same as lines of an answer."""
    return [f"note        {note}" for note in finding_notes(arguments, job)]


def insist_verified(job: Job) -> None:
    """The same for a job that is only looked at.

    Raises:
        VerificationError: it holds what was not allowed.
    """
    if wrong := refused_findings(job):
        more = f"\n  and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise VerificationError(f"{job.name}: {sentence(wrong[0])}{more}", remedy=remedy_of(wrong))


def reason_behind(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """What refuses commands that a person types one after the other: units and modes of those before count."""
    allowed = check_names(allowed)
    said: deque[bytes] = deque(maxlen=_REMEMBERED)

    def reason(command: bytes) -> str:
        """Why it is refused, empty if it is not; what is refused was not said."""
        said.append(command)
        last = (one for one in scan(tuple(said), profile) if one.index == len(said) - 1)
        wrong = _first_refused(last, allowed)
        if wrong:
            said.pop()
        return wrong

    return reason


def reason_against(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """What refuses commands that a person types meanwhile: the reason, empty if there is none."""

    def reason(command: bytes) -> str:
        """The first thing that is refused and not allowed."""
        return _first_refused(scan([command], profile), allowed)

    return reason


def _first_refused(findings: Iterable[Diagnostic], allowed: Collection[str]) -> str:
    wrong = (one for one in findings if one.is_error and one.code not in allowed)
    return next((f"{one.message}; {one.reason} [{one.code}]" for one in wrong), "")
