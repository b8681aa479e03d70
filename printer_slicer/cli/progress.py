"""Report the progress of a print: a bar on a terminal, JSON lines, or plain lines; and messages of the printer."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from printer_slicer.cli.output import PATIENCE, Milestones, sanitize, say
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
    event_kind,
)
from printer_slicer.texts import format_duration

if TYPE_CHECKING:
    from printer_slicer.printing import Controls, PrintResult

__all__ = ["print_with", "progress"]


class progress:  # noqa: N801 - used like a function
    """Turns events into a progress bar, JSON lines, or plain lines without a terminal.

    Args:
        arguments: the command line.
        job: the print.
        events: whether --json prints all of them.
        shares: whether to write a line per 5 %; if not, only one a minute.
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
            """Update the bar."""
            layer = self._job.layer_of(done)
            name = f"layer {layer} of {last}" if layer else "starting"
            bar.update(task, completed=done, description=name)

        self._bar = update

    def _tell(self, event: Event) -> None:
        if isinstance(event, Accepted):
            self._done = event.acknowledged
            self._advance(event.acknowledged)
        # During heating, temperatures are the only events.
        self._lines.reached(self._done, max(len(self._job.commands), 1), self._where)
        if isinstance(event, Accepted):
            return
        if self._json and not isinstance(event, LineSent):
            print(json.dumps({"event": event_kind(event), **asdict(event)}, default=str), flush=True)
        elif (not self._quiet and (text := _for_people(event))) or (
            self._verbose and (text := _as_line(event))
        ):
            print(sanitize(text), file=sys.stderr)

    def _where(self) -> str:
        """Describe the progress of the job."""
        layer, last = self._job.layer_of(self._done), self._last_layer()
        return f"{self._done} of {len(self._job.commands)} commands" + (
            f", layer {layer} of {last}" if layer else ""
        )

    def _last_layer(self) -> int:
        """Return the number of the last layer; 0 if unknown."""
        return self._job.plan.n_layers if self._job.plan else max(self._job.marks.values(), default=0)

    def _advance(self, done: int) -> None:
        """Report progress in steps of 1 %."""
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


def print_with(
    arguments: argparse.Namespace, job: Job, checkpoint: Path, begin: Callable[..., PrintResult]
) -> int:
    """Print with progress and keys, and print the result.

    Args:
        arguments: the command line.
        job: to print.
        checkpoint: file for the progress of the print.
        begin: starts the print, with the arguments that `print_job` and `resume_print` have in common.

    Raises:
        VerificationError: the printer is not at the end position of the job.
    """
    from printer_slicer.printing import Controls

    controls = Controls()
    with (
        progress(arguments, job, events=True, shares=True) as tell,
        _keys(arguments, controls),
    ):
        done = begin(
            on_event=tell,
            checkpoint=checkpoint,
            controls=controls,
            reconnect=arguments.reconnect,
            guard=arguments.guard,
            dtr={"on": True, "off": False}.get(arguments.dtr),
        )
    position = {
        True: "the printer is at the end position of the job",
        False: "the printer is NOT at the end position of the job",
    }
    if arguments.json:
        print(json.dumps({"event": "finished", **asdict(done)}))
    else:
        known = f"; {position[done.verified]}" if done.verified is not None else ""
        say(
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


def _keys(arguments: argparse.Namespace, controls: Controls) -> AbstractContextManager[None]:
    """Return a context in which keys control the print, if stdin is a terminal."""
    if arguments.quiet or not sys.stdin or not sys.stdin.isatty():
        return nullcontext()
    from printer_slicer.cli.keys import keys

    return keys(controls)


def _for_people(event: Event) -> str:
    """Format an event that every user must see; empty for others."""
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
        return f"the printer requests: {event.name}"
    return ""


def _as_line(event: Event) -> str:
    """Format an event for --verbose; empty for others."""
    if isinstance(event, Message):
        return event.text
    if isinstance(event, ResendRequested):
        return f"the printer requests a resend from line {event.number}"
    if isinstance(event, Temperature):
        wanted = {True: " (waiting)", False: ""}[event.waiting]
        heaters = (
            f"{one.name} {one.actual:g}" + (f"/{one.target:g}" if one.target else "")
            for one in event.readings
        )
        return f"{', '.join(heaters)} °C{wanted}"
    return ""
