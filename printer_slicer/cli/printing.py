"""`dry-run`, `print` and `sim`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from printer_slicer.cli.common import (
    PATIENCE,
    check_writable,
    profile_from,
    refuse_same,
    say,
    stages,
    visible,
    write_file,
)
from printer_slicer.cli.models import plate_from, plate_name, refuse_model_flags
from printer_slicer.cli.policy import (
    finding_facts,
    insist_on_policy,
    insist_verified,
    reason_against,
    refused,
)
from printer_slicer.cli.projects import with_projects
from printer_slicer.cli.simulating import (
    faults_of,
    firmware_of,
    planted_facts,
    planted_lines,
    serve_printer,
    violation_lines,
)
from printer_slicer.cli.verdicts import verdict_facts, verdict_text
from printer_slicer.errors import UsageError, VerificationError
from printer_slicer.gcode import spoken
from printer_slicer.jobs import Job, is_gcode, job_from, job_of
from printer_slicer.pipeline import quiet
from printer_slicer.stream.events import (
    Accepted,
    Action,
    Event,
    Identified,
    Message,
    Note,
    Numbered,
    Paused,
    Prompt,
    ResendAsked,
    Resumed,
    Stopping,
    Temperature,
)

if TYPE_CHECKING:
    from printer_slicer.cli.common import Stages
    from printer_slicer.printing import Done
    from printer_slicer.profile import Profile
    from printer_slicer.sim.faults import Faults
    from printer_slicer.verdict import Verdict

__all__ = ["dry_run_command", "print_command", "print_with", "progress", "sim_command"]

_SIMULATED = "sim:"


def dry_run_command(arguments: argparse.Namespace) -> int:
    """Print on the simulated printer and say what would happen."""
    faults = faults_of(arguments)
    if arguments.picture:
        from printer_slicer.drawing.canvas import check_picture

        check_picture(arguments.picture)
    profile = profile_from(arguments, slices=not _has_gcode(arguments))
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
        print(json.dumps(facts))
    else:
        told = [verdict_text(arguments, verdict, job, profile), *planted_lines(faults), *_repaired(job)]
        say(arguments, "\n".join(told))
    _insist(verdict)
    insist_verified(job)
    return 0


def print_command(arguments: argparse.Namespace) -> int:
    """Print over a port; `sim:` is the simulated printer in this process."""
    profile = profile_from(arguments, slices=not _has_gcode(arguments))
    with stages(arguments) as report:
        job, known = _job(arguments, profile, report)
    if arguments.json and known["models"]:
        print(json.dumps({"event": "models", **known}), flush=True)
    plan = f"{job.plan.n_layers} layers, " if job.plan else ""
    first = f"{job.name}: {plan}{len(job.commands)} commands, {spoken(job.seconds)} of motion"
    say(arguments, "\n  ".join([first, *_repaired(job)]))
    if arguments.json and job.repairs.count:
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


def _job(arguments: argparse.Namespace, profile: Profile, report: Stages) -> tuple[Job, dict[str, Any]]:
    """The job that the files of the command line make, and what is known about models, for JSON."""
    if _has_gcode(arguments):
        refuse_model_flags(arguments)
        return job_from(arguments.models[0], profile, report=report, strict=arguments.strict), {
            "models": [],
            "warnings": [],
        }
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
    from printer_slicer.verdict import dry_run

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
    from printer_slicer.drawing.canvas import picture_bytes
    from printer_slicer.drawing.rehearsal import Mark, rehearsal_picture
    from printer_slicer.verdict import sentence

    assert verdict.account is not None
    found = [Mark(sentence(fault), fault.z, fault.place) for fault in verdict.faults if not fault.harmless]
    title = f"{verdict.job}: {'prints as it should' if verdict.ok else 'do NOT print it'}"
    return picture_bytes(
        rehearsal_picture(verdict.account, found, title, profile.printer.corners, profile.material.max_flow),
        path,
    )


def _insist(verdict: Verdict) -> None:
    if not verdict.ok:
        more = f"\n  and {len(verdict.problems) - 1} more problems" if len(verdict.problems) > 1 else ""
        raise VerificationError(f"{verdict.job}: {verdict.problems[0]}{more}")


class progress:  # noqa: N801 - used like a function
    """Turns events into a progress bar, into JSON lines, or where there is no terminal into a line now and then.

    Args:
        arguments: of the command.
        job: that is printed.
        events: whether --json tells all of them.
        shares: whether each 5 % is worth a line; else only minutes are.
    """

    def __init__(
        self, arguments: argparse.Namespace, job: Job, *, events: bool, shares: bool = False
    ) -> None:
        from printer_slicer.cli.milestones import Milestones

        self._job = job
        self._done = 0
        self._quiet = arguments.quiet or arguments.json
        self._verbose = arguments.verbose and not arguments.quiet
        self._json = arguments.json and events
        self._bar: Callable[[int], None] | None = None
        self._close: Callable[[], object] = lambda: None
        self._wanted = not (arguments.json or arguments.quiet) and sys.stderr.isatty()
        self._lines = Milestones(
            "printing", wanted=not (self._quiet or sys.stderr.isatty()), every_share=shares
        )
        self._begun = monotonic()
        self._shown = -1

    def __enter__(self) -> Callable[[Event], None]:
        return self._tell

    def __exit__(self, *_: object) -> None:
        self._close()

    def _open_bar(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:>3.0f} %"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        task = bar.add_task("printing", total=len(self._job.commands))
        bar.start()
        self._close = bar.stop
        last = self._last_layer()

        def update(done: int) -> None:
            """So many commands are done."""
            layer = self._job.layer_of(done)
            name = f"layer {layer} of {last}" if layer else "starting"
            bar.update(task, completed=done, description=name)

        self._bar = update

    def _tell(self, event: Event) -> None:
        if isinstance(event, Accepted):
            self._done = event.acknowledged
            self._advance(event.acknowledged)
        # While it heats, temperatures are all that is told.
        self._lines.reached(self._done, max(len(self._job.commands), 1), self._where)
        if isinstance(event, Accepted):
            return
        if self._json and not isinstance(event, Numbered):
            print(
                json.dumps({"event": type(event).__name__.lower(), **asdict(event)}, default=str), flush=True
            )
        elif (not self._quiet and (text := _for_people(event))) or (
            self._verbose and (text := _as_line(event))
        ):
            print(visible(text), file=sys.stderr)

    def _where(self) -> str:
        """How far the job has come, in words."""
        layer, last = self._job.layer_of(self._done), self._last_layer()
        return f"{self._done} of {len(self._job.commands)} commands" + (
            f", layer {layer} of {last}" if layer else ""
        )

    def _last_layer(self) -> int:
        """The number of the last layer, 0 if the job does not tell."""
        return self._job.plan.n_layers if self._job.plan else max(self._job.marks.values(), default=0)

    def _advance(self, done: int) -> None:
        """A hundred steps are enough for people and for programs."""
        if self._wanted and self._bar is None and monotonic() - self._begun > PATIENCE:
            self._open_bar()
        percent = done * 100 // len(self._job.commands)
        if percent == self._shown:
            return
        self._shown = percent
        if self._json:
            total = len(self._job.commands)
            line = {"event": "progress", "done": done, "total": total, "layer": self._job.layer_of(done)}
            print(json.dumps(line), flush=True)
        elif self._bar:
            self._bar(done)


def _for_people(event: Event) -> str:
    """What a person must know of an event; empty for the rest."""
    if isinstance(event, Stopping):
        return "stopping; Ctrl-C again halts the printer at once"
    if isinstance(event, Paused):
        return f"paused: {event.reason}"
    if isinstance(event, Resumed):
        return "going on"
    if isinstance(event, Note):
        return event.text
    if isinstance(event, Identified):
        return event.advice
    if isinstance(event, Prompt) and event.text + "".join(event.buttons):
        buttons = ", ".join(f"{number} {button}" for number, button in enumerate(event.buttons))
        return f"the printer asks: {event.text} [{buttons}]"
    if isinstance(event, Action) and not event.name.startswith("prompt_"):
        return f"the printer asks: {event.name}"
    return ""


def _as_line(event: Event) -> str:
    """What a person wants to read of an event when every word of the printer counts; empty for the rest."""
    if isinstance(event, Message):
        return event.text
    if isinstance(event, ResendAsked):
        return f"the printer asks for everything from line {event.number} again"
    if isinstance(event, Temperature):
        wanted = {True: " (waiting)", False: ""}[event.waiting]
        heaters = (
            f"{one.name} {one.actual:g}" + (f"/{one.target:g}" if one.target else "")
            for one in event.readings
        )
        return f"{', '.join(heaters)} °C{wanted}"
    return ""


def _repair_facts(job: Job) -> list[dict[str, Any]]:
    """What was put right in the part; what tells it is loaded only then."""
    if not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_facts

    return repair_facts(job.repairs)


def _repaired(job: Job) -> list[str]:
    """The same for people."""
    if not job.repairs.count:
        return []
    from printer_slicer.cli.facts import repair_sentences

    return repair_sentences(_repair_facts(job))


def sim_command(arguments: argparse.Namespace) -> int:
    """Serve the simulated printer on a pseudo-terminal or over TCP until interrupted."""
    from printer_slicer.verdict import Comparison, judge, layer_counter

    _look_at_sim_flags(arguments)
    faults = faults_of(arguments)
    profile = profile_from(arguments, slices=bool(arguments.models) and not _has_gcode(arguments))
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
