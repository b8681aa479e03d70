"""Report the progress of a print, and messages of the printer: as a progress bar, JSON lines or plain lines."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from printer_slicer.cli.output import BAR_DELAY, Milestones, print_text, sanitize
from printer_slicer.errors import VerificationError
from printer_slicer.jobs import Job
from printer_slicer.stream.events import (
    Accepted,
    Action,
    Event,
    Identified,
    LineSent,
    Message,
    Paused,
    PoorLink,
    Prompt,
    ResendRequested,
    Resumed,
    Stopping,
    StreamWarning,
    Temperature,
    get_event_kind,
)
from printer_slicer.texts import format_duration
from printer_slicer.values import as_dict

if TYPE_CHECKING:
    from printer_slicer.printing import Controls, PrintResult

__all__ = ["ProgressDisplay", "print_with_progress"]


class ProgressDisplay:
    """Shows the events of a print: on a progress bar, as JSON lines, or as plain lines without a terminal.

    Args:
        arguments: the command line.
        job: the job that is printed.
        events: whether --json prints all events.
        shares: whether to write a plain line per 5 %; if not, only one a minute.
    """

    def __init__(
        self, arguments: argparse.Namespace, job: Job, *, events: bool, shares: bool = False
    ) -> None:
        self._job = job
        self._done = 0
        self._quiet = arguments.quiet or arguments.json
        self._verbose = arguments.verbose and not arguments.quiet
        self._json = arguments.json and events
        self._bar: Callable[[int], None] | None = None
        self._close: Callable[[], object] = lambda: None
        self._may_open_bar = not (arguments.json or arguments.quiet) and sys.stderr.isatty()
        self._lines = Milestones(
            "printing", wanted=not (self._quiet or sys.stderr.isatty()), every_share=shares
        )
        self._begun = monotonic()
        self._last_percent = -1

    def __enter__(self) -> Callable[[Event], None]:
        return self._handle_event

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
        last = self._job.last_layer

        def update(done: int) -> None:
            """Update the bar."""
            layer = self._job.layer_of(done)
            name = f"layer {layer} of {last}" if layer else "starting"
            bar.update(task, completed=done, description=name)

        self._bar = update

    def _handle_event(self, event: Event) -> None:
        if isinstance(event, Accepted):
            self._done = event.acknowledged
            self._report_percent(event.acknowledged)
        # During heating, temperatures are the only events.
        self._lines.report_if_due(self._done, max(len(self._job.commands), 1), self._describe_position)
        if isinstance(event, Accepted):
            return
        if self._json and not isinstance(event, LineSent):
            print(json.dumps({"event": get_event_kind(event), **as_dict(event)}, default=str), flush=True)
        elif (not self._quiet and (text := _format_for_user(event))) or (
            self._verbose and (text := _format_details(event))
        ):
            print(sanitize(text), file=sys.stderr)

    def _describe_position(self) -> str:
        """Describe the current position in the job: commands and layers."""
        layer, last = self._job.layer_of(self._done), self._job.last_layer
        return f"{self._done} of {len(self._job.commands)} commands" + (
            f", layer {layer} of {last}" if layer else ""
        )

    def _report_percent(self, done: int) -> None:
        """Report the progress in steps of 1 %, on the bar or as JSON."""
        if self._may_open_bar and self._bar is None and monotonic() - self._begun > BAR_DELAY:
            self._open_bar()
        percent = done * 100 // len(self._job.commands)
        if percent == self._last_percent:
            return
        self._last_percent = percent
        if self._json:
            total = len(self._job.commands)
            line = {"event": "progress", "done": done, "total": total, "layer": self._job.layer_of(done)}
            print(json.dumps(line), flush=True)
        elif self._bar:
            self._bar(done)


def print_with_progress(
    arguments: argparse.Namespace, job: Job, checkpoint: Path, start_print: Callable[..., PrintResult]
) -> int:
    """Run a print, show its progress, let keys control it, and report the result.

    Args:
        arguments: the command line.
        job: the job to print.
        checkpoint: file for the progress of the print.
        start_print: function that prints, called with the arguments that `print_job` and `resume_print` share.

    Raises:
        VerificationError: the printer is not at the end position of the job.
    """
    from printer_slicer.printing import Controls

    controls = Controls()
    with (
        ProgressDisplay(arguments, job, events=True, shares=True) as tell,
        _enable_keys(arguments, controls),
    ):
        done = start_print(
            on_event=tell,
            checkpoint=checkpoint,
            controls=controls,
            reconnect=arguments.reconnect,
            guard=arguments.guard,
            dtr={"on": True, "off": False}.get(arguments.dtr),
            **_report_when_ready(arguments),
        )
    position = {
        True: "the printer is at the end position of the job",
        False: "the printer is NOT at the end position of the job",
    }
    if arguments.json:
        print(json.dumps({"event": "finished", **as_dict(done)}))
    else:
        known = f"; {position[done.verified]}" if done.verified is not None else ""
        print_text(
            arguments,
            f"done: {done.commands} commands in {format_duration(done.seconds)}{known}\n  link: {done.link}",
        )
    if done.link.warning is not None and not arguments.json:
        print(f"warning: {done.link.warning.text}", file=sys.stderr)
    if done.verified is False:
        raise VerificationError(
            f"{job.name}: the printer accepted all commands, but is not at the end position of the job",
            remedy="Inspect the part: commands were lost on the cable, or moves were outside the printer's limits",
        )
    return 0


def _report_when_ready(arguments: argparse.Namespace) -> dict[str, Callable[[Path], None]]:
    """Return the option of `print_job` that writes the file named by --ready-file; nothing without that option."""
    if arguments.ready_file is None:
        return {}
    from printer_slicer.printing.detached import write_ready_file

    return {"on_ready": partial(write_ready_file, arguments.ready_file)}


def _enable_keys(arguments: argparse.Namespace, controls: Controls) -> AbstractContextManager[None]:
    """Return a context in which keys control the print, if stdin is a terminal and --quiet is not given."""
    if arguments.quiet or not sys.stdin or not sys.stdin.isatty():
        return nullcontext()
    from printer_slicer.cli.keys import control_by_keys

    return control_by_keys(controls)


def _format_for_user(event: Event) -> str:
    """Format an event that every user must see; return an empty text for other events."""
    if isinstance(event, Stopping):
        return "stopping; Ctrl-C again halts the printer at once"
    if isinstance(event, Paused):
        return f"paused: {event.reason}"
    if isinstance(event, Resumed):
        return "resumed"
    if isinstance(event, StreamWarning):
        return event.text
    if isinstance(event, PoorLink):
        return f"warning: {event.text}"
    if isinstance(event, Identified):
        return event.advice
    if isinstance(event, Prompt) and event.text + "".join(event.buttons):
        buttons = ", ".join(f"{number} {button}" for number, button in enumerate(event.buttons))
        return f"the printer asks: {event.text} [{buttons}]"
    if isinstance(event, Action) and not event.name.startswith("prompt_"):
        return event.text
    return ""


def _format_details(event: Event) -> str:
    """Format an event that only --verbose shows; return an empty text for other events."""
    if isinstance(event, Message | ResendRequested):
        return event.text
    if isinstance(event, Temperature):
        wanted = {True: " (waiting)", False: ""}[event.waiting]
        heaters = (
            f"{one.name} {one.actual:g}" + (f"/{one.target:g}" if one.target else "")
            for one in event.readings
        )
        return f"{', '.join(heaters)} °C{wanted}"
    return ""
