"""Make the job of a command line, and print, list or reject it because of its findings."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.output import print_text, sanitize
from printer_slicer.cli.unused_options import reject_model_options
from printer_slicer.diagnostics import (
    Diagnostic,
    as_former_json,
    as_json,
    format_first_error,
    format_remedies,
    raise_on_errors,
    sentence,
)
from printer_slicer.errors import VerificationError
from printer_slicer.input_files import is_gcode
from printer_slicer.inspection.lint.scan import lint_file
from printer_slicer.jobs import Job
from printer_slicer.profile import Profile

if TYPE_CHECKING:
    from printer_slicer.cli.output import StageReport

__all__ = [
    "check_policy",
    "choose_profile_arguments",
    "format_disallowed_errors",
    "format_errors",
    "format_job_repair_sentences",
    "format_note_sentences",
    "format_notes",
    "list_diagnostic_facts",
    "list_disallowed_errors",
    "list_finding_facts",
    "list_job_repair_facts",
    "list_notes",
    "make_job",
    "require_no_errors",
]

_MAX_SHOWN = 5  # findings, without --verbose
_MAX_ERRORS = 12  # errors of a rejected job, without --verbose


def _has_gcode(arguments: argparse.Namespace) -> bool:
    """Return whether the command line names G-code instead of models."""
    return any(map(is_gcode, arguments.models))


def choose_profile_arguments(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of `load_selected_profile` that depend on whether models or G-code are given.

    Raises:
        UsageError: options that only models need are given with G-code, or several files.
    """
    if _has_gcode(arguments):
        reject_model_options(arguments)
    return {
        "slices": bool(arguments.models) and not _has_gcode(arguments),
        "gcode": arguments.models[0] if _has_gcode(arguments) else None,
    }


def make_job(
    arguments: argparse.Namespace, profile: Profile, report: StageReport
) -> tuple[Job, dict[str, Any]]:
    """Make the job from the files of a command line; return it, and facts about its models for JSON."""
    if _has_gcode(arguments):
        report("reading")
        return lint_file(arguments.models[0], profile), {"models": [], "warnings": []}
    from printer_slicer.cli.models import apply_projects, format_model_names, load_plate
    from printer_slicer.slice_jobs import job_of

    report("loading")
    mesh, plate = load_plate(arguments, profile, report)
    profile, plate = apply_projects(arguments, profile, mesh, plate)
    name = format_model_names(arguments.models)
    job = job_of(
        mesh,
        profile,
        name=name,
        placement=plate.placement,
        report=report,
        strict=arguments.strict,
        strict_supports=arguments.strict_supports,
        comments=plate.comments,
    )
    return job, plate.collect_facts()


def list_job_repair_facts(job: Job) -> list[dict[str, Any]]:
    """Return the repairs of a job's part for JSON; import the module for repairs only if there are any."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.facts.slicing import list_repair_facts

    return list_repair_facts(job.repairs)


def format_job_repair_sentences(job: Job) -> list[str]:
    """Return the repairs of a job's part as sentences."""
    if job.repairs is None or not job.repairs.count:
        return []
    from printer_slicer.facts.slicing import format_repair_sentences

    return format_repair_sentences(list_job_repair_facts(job))


def check_policy(arguments: argparse.Namespace, job: Job, refusal: str = "not printed") -> Job:
    """Print the findings of a job before it is sent, and reject it if it has errors that are not allowed.

    Args:
        arguments: the command line.
        job: the job with its findings.
        refusal: consequence of the rejection for the message, such as "not printed".

    Returns:
        The job that allows the findings named by --allow.

    Raises:
        PolicyError: the job has errors that are not allowed.
        UsageError: --allow names an unknown finding.
    """
    job = job.allowing(arguments.allow)
    if arguments.json and job.findings:
        print(json.dumps({"event": "findings", "findings": list_finding_facts(job)}), flush=True)
    if not (arguments.json or arguments.quiet):
        for note in format_note_sentences(arguments, job):
            print(sanitize(f"printer-slicer: warning: {note}"), file=sys.stderr)
        for line in format_errors(arguments, format_disallowed_errors(job)):
            print_text(arguments, line)
    raise_on_errors(job.findings, job.allowed, name=job.name, refusal=refusal)
    return job


def format_disallowed_errors(job: Job) -> list[str]:
    """Return a sentence for each error of a job that is not allowed."""
    return [sentence(one) for one in list_disallowed_errors(job)]


def list_disallowed_errors(job: Job) -> list[Diagnostic]:
    """Return the errors of a job that are not allowed."""
    return [one for one in job.findings if one.is_error and one.code not in job.allowed]


def list_finding_facts(job: Job) -> list[dict[str, Any]]:
    """Return all findings of a job for JSON, with their former keys."""
    return [as_former_json(one) | {"allowed": one.code in job.allowed} for one in job.findings]


def list_diagnostic_facts(job: Job, diagnostics: Iterable[Diagnostic]) -> list[dict[str, Any]]:
    """Return diagnostics of a job for JSON: its own findings, and those of a comparison or a dry run."""
    return [as_json(one) | {"allowed": one.code in job.allowed} for one in diagnostics]


def list_notes(job: Job, faults: Collection[Diagnostic] = ()) -> list[Diagnostic]:
    """Return the findings that do not prevent printing; leave out warnings that repeat what a dry run found."""
    notes = [one for one in job.findings if not one.is_error or one.code in job.allowed]
    return [one for one in notes if one.is_error or not _is_reported(one, faults)]


def format_note_sentences(
    arguments: argparse.Namespace, job: Job, faults: Collection[Diagnostic] = ()
) -> list[str]:
    """Return a sentence for each finding that does not prevent printing; only the first few without --verbose.

    Args:
        arguments: the command line.
        job: the job with its findings.
        faults: what a dry run found; warnings that repeat it are left out.
    """
    shown = list_notes(job, faults)
    most = len(shown) if arguments.verbose else _MAX_SHOWN
    more = [f"... and {len(shown) - most} more (-v shows all)"] if len(shown) > most else []
    return [*(sentence(one) for one in shown[:most]), *more]


def _is_reported(finding: Diagnostic, faults: Collection[Diagnostic]) -> bool:
    """Return whether a dry run found the same: unknown commands by line, other codes once for all commands."""
    same = [one for one in faults if one.code == finding.code]
    return bool(same) and (finding.code != "unknown" or finding.line in {one.line for one in same})


def format_notes(arguments: argparse.Namespace, job: Job, faults: Collection[Diagnostic] = ()) -> list[str]:
    """Format the findings that do not prevent printing as lines of the output; leave out those of a dry run."""
    return [f"{'warning':<12}{note}" for note in format_note_sentences(arguments, job, faults)]


def format_errors(arguments: argparse.Namespace, errors: Sequence[str]) -> list[str]:
    """Format errors as lines of the output; a single error gets no line, because the final message names it."""
    most = len(errors) if arguments.verbose else _MAX_ERRORS
    more = [f"error       ... and {len(errors) - most} more (-v shows all)"] if len(errors) > most else []
    return [*(f"error       {one}" for one in errors[:most]), *more] if len(errors) > 1 else []


def require_no_errors(job: Job) -> None:
    """Raise an error if a checked job has errors that are not allowed.

    Raises:
        VerificationError: the job has such errors.
    """
    if wrong := list_disallowed_errors(job):
        raise VerificationError(
            f"{job.name}: {format_first_error(list(map(sentence, wrong)))}", remedy=format_remedies(wrong)
        )
