"""What was found in a job before it is sent: told, listed for programs, or refused."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Collection
from dataclasses import asdict
from typing import Any

from printer_slicer.cli.common import visible
from printer_slicer.errors import VerificationError
from printer_slicer.jobs import Job
from printer_slicer.policy import insist, scan, sentence
from printer_slicer.profile import Profile

__all__ = [
    "finding_facts",
    "finding_lines",
    "insist_on_policy",
    "insist_verified",
    "reason_against",
    "refused",
]

_TOLD = 5  # without --verbose


def insist_on_policy(arguments: argparse.Namespace, job: Job) -> Job:
    """Say what is in the job, before its first byte; the job with what is allowed.

    Raises:
        PolicyError: it holds what was not allowed.
        UsageError: a name that was allowed does not exist.
    """
    job = job.allowing(arguments.allow)
    if arguments.json and job.findings:
        print(json.dumps({"event": "findings", "findings": finding_facts(arguments, job)}), flush=True)
    if not (arguments.json or arguments.quiet):
        for line in finding_lines(arguments, job):
            print(visible(line.replace("note        ", "printer-slicer: warning: ", 1)), file=sys.stderr)
    insist(job.findings, job.allowed, name=job.name)
    return job


def refused(arguments: argparse.Namespace, job: Job) -> list[str]:
    """What was found and is not allowed, one sentence each.

    Raises:
        UsageError: a name that was allowed does not exist.
    """
    allowed = job.allowing(arguments.allow).allowed
    return [sentence(one) for one in job.findings if one.refused and one.name not in allowed]


def finding_facts(arguments: argparse.Namespace, job: Job) -> list[dict[str, Any]]:
    """All findings, ready for JSON."""
    allowed = job.allowing(arguments.allow).allowed
    return [asdict(one) | {"allowed": one.name in allowed} for one in job.findings]


def finding_lines(arguments: argparse.Namespace, job: Job) -> list[str]:
    """What was found and does not keep the job from being printed, for people."""
    allowed = job.allowing(arguments.allow).allowed
    told = [one for one in job.findings if not one.refused or one.name in allowed]
    most = len(told) if arguments.verbose else _TOLD
    lines = [f"note        {sentence(one)}" for one in told[:most]]
    return (
        [*lines, f"note        ... and {len(told) - most} more (-v tells all)"] if len(told) > most else lines
    )


def insist_verified(arguments: argparse.Namespace, job: Job) -> None:
    """The same for a job that is only looked at.

    Raises:
        VerificationError: it holds what was not allowed.
    """
    if wrong := refused(arguments, job):
        more = f"\n  and {len(wrong) - 1} more" if len(wrong) > 1 else ""
        raise VerificationError(f"{job.name}: {wrong[0]}{more}", remedy="if it is meant: --allow NAME")


def reason_against(profile: Profile, allowed: Collection[str]) -> Callable[[bytes], str]:
    """What refuses commands that a person types meanwhile: the reason, empty if there is none."""

    def reason(command: bytes) -> str:
        """The first thing that is refused and not allowed."""
        wrong = (one for one in scan([command], profile) if one.refused and one.name not in allowed)
        return next((f"{one.what}; {one.why} [{one.name}]" for one in wrong), "")

    return reason
