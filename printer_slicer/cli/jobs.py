"""The job of a command line, and its findings: printed, listed, or refused."""

from __future__ import annotations

import argparse
import json
import sys
from collections import deque
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.arguments import refuse_model_flags
from printer_slicer.cli.output import sanitize
from printer_slicer.diagnostics import (
    Diagnostic,
    as_json,
    check_allowed_codes,
    raise_on_errors,
    remedy_of,
    sentence,
)
from printer_slicer.errors import VerificationError
from printer_slicer.inspection.lint.scan import lint_file, scan
from printer_slicer.jobs import Job, is_gcode
from printer_slicer.profile import Profile

if TYPE_CHECKING:
    from printer_slicer.cli.output import Stages

__all__ = [
    "command_check",
    "console_check",
    "finding_facts",
    "finding_notes",
    "format_findings",
    "insist_on_policy",
    "insist_verified",
    "job_from",
    "profile_options",
    "refused",
    "refused_findings",
    "repairs_facts",
    "repairs_lines",
]

_MOST_SHOWN = 5  # findings without --verbose
_REMEMBERED = 500  # earlier commands of a console, whose units and modes apply


def _has_gcode(arguments: argparse.Namespace) -> bool:
    """Return whether G-code is given instead of models."""
    return any(map(is_gcode, arguments.models))


def profile_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return arguments for `profile_from`: G-code brings its own settings, a part is sliced with the profile."""
    return {
        "slices": bool(arguments.models) and not _has_gcode(arguments),
        "gcode": arguments.models[0] if _has_gcode(arguments) else None,
    }


def job_from(arguments: argparse.Namespace, profile: Profile, report: Stages) -> tuple[Job, dict[str, Any]]:
    """Return the job of the files of a command line, and facts about its models, for JSON."""
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
    """Return the repairs of the part, for JSON; the module for them is imported only if there are any."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_facts

    return repair_facts(job.repairs)


def repairs_lines(job: Job) -> list[str]:
    """Return the repairs of the part as sentences."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_sentences

    return repair_sentences(repairs_facts(job))


def insist_on_policy(arguments: argparse.Namespace, job: Job, refusal: str = "not printed") -> Job:
    """Print the findings of a job before it is sent, and refuse errors that are not allowed.

    Args:
        arguments: the command line.
        job: with its findings.
        refusal: what does not happen to a refused job, for the message.

    Returns:
        The job with the names that --allow accepts.

    Raises:
        PolicyError: the job has errors that are not allowed.
        UsageError: --allow names an unknown finding.
    """
    job = job.allowing(arguments.allow)
    if arguments.json and job.findings:
        print(json.dumps({"event": "findings", "findings": finding_facts(job)}), flush=True)
    if not (arguments.json or arguments.quiet):
        for note in finding_notes(arguments, job):
            print(sanitize(f"printer-slicer: warning: {note}"), file=sys.stderr)
    raise_on_errors(job.findings, job.allowed, name=job.name, refusal=refusal)
    return job


def refused(job: Job) -> list[str]:
    """Return the errors that are not allowed, one sentence each."""
    return [sentence(one) for one in refused_findings(job)]


def refused_findings(job: Job) -> list[Diagnostic]:
    """Return the errors that are not allowed."""
    return [one for one in job.findings if one.is_error and one.code not in job.allowed]


def finding_facts(job: Job) -> list[dict[str, Any]]:
    """Return all findings for JSON."""
    return [as_json(one) | {"allowed": one.code in job.allowed} for one in job.findings]


def finding_notes(arguments: argparse.Namespace, job: Job) -> list[str]:
    """Return the findings that do not prevent printing, one sentence each."""
    shown = [one for one in job.findings if not one.is_error or one.code in job.allowed]
    most = len(shown) if arguments.verbose else _MOST_SHOWN
    more = [f"... and {len(shown) - most} more (-v shows all)"] if len(shown) > most else []
    return [*(sentence(one) for one in shown[:most]), *more]


def format_findings(arguments: argparse.Namespace, job: Job) -> list[str]:
    """Return the findings that do not prevent printing, as lines of the output."""
    return [f"note        {note}" for note in finding_notes(arguments, job)]


def insist_verified(job: Job) -> None:
    """Raise an error if a checked job has errors that are not allowed.

    Raises:
        VerificationError: it has.
    """
    if wrong := refused_findings(job):
        more = f"\n  and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise VerificationError(f"{job.name}: {sentence(wrong[0])}{more}", remedy=remedy_of(wrong))


def console_check(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """Return a function that checks commands typed one after the other, with the units and modes set before."""
    allowed = check_allowed_codes(allowed)
    typed: deque[bytes] = deque(maxlen=_REMEMBERED)

    def reason(command: bytes) -> str:
        """Return why a command is refused, empty if it is not; refused commands do not count later."""
        typed.append(command)
        last = (one for one in scan(tuple(typed), profile) if one.index == len(typed) - 1)
        wrong = _first_refused(last, allowed)
        if wrong:
            typed.pop()
        return wrong

    return reason


def command_check(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """Return a function that checks single commands typed during a print."""

    def reason(command: bytes) -> str:
        """Return why a command is refused, empty if it is not."""
        return _first_refused(scan([command], profile), allowed)

    return reason


def _first_refused(findings: Iterable[Diagnostic], allowed: Collection[str]) -> str:
    wrong = (one for one in findings if one.is_error and one.code not in allowed)
    return next((f"{one.message}; {one.reason} [{one.code}]" for one in wrong), "")
