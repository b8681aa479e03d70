"""What OctoPrint's interface tells of a printer: its state, its temperatures, and the job that it prints."""

from __future__ import annotations

from time import time
from typing import Any, Final

from printer_slicer.server.targets import Target

__all__ = ["describe_job", "describe_state", "list_temperatures"]

_STATES: Final = {
    "stopping": "Pausing",
    "parking": "Pausing",
    "paused": "Paused",
    "returning": "Resuming",
    "cancelling": "Cancelling",
}
"""OctoPrint's names for the states of a print; all others are `Printing`."""


def describe_state(target: Target) -> dict[str, Any]:
    """Return the state of the printer in OctoPrint's words."""
    state = str(target.status.get("state", ""))
    paused, printing = state == "paused", target.printer.job is not None
    text = _STATES.get(state, "Printing") if printing else "Operational"
    flags = {
        "operational": True,
        "printing": printing and not paused,
        "paused": paused,
        "pausing": text == "Pausing",
        "resuming": text == "Resuming",
        "cancelling": text == "Cancelling",
        "finishing": False,
        "sdReady": False,
        "error": False,
        "ready": not printing,
        "closedOrError": False,
    }
    return {"text": text, "flags": flags}


def list_temperatures(status: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return the temperatures of the heaters that a print knows, by OctoPrint's names: `tool0`, `bed`."""
    found = {}
    for name, (actual, wanted) in status.get("temperatures", {}).items():
        tool = name[1:] or "0"
        shown = "bed" if name == "B" else f"tool{tool}" if name[:1] == "T" and tool.isdecimal() else ""
        if shown and actual is not None:
            found[shown] = {"actual": float(actual), "target": float(wanted or 0), "offset": 0.0}
    return found


def describe_job(target: Target) -> dict[str, Any]:
    """Return the job of a printer in OctoPrint's words."""
    queue, status = target.services.queue, target.status
    name = size = seconds = elapsed = None
    if target.printer.job is not None:
        job = queue.find_job(target.printer.job)
        facts = queue.read_facts(job.file)
        name, size = job.name, queue.find_file(job.file).size
        seconds = facts.seconds if facts else None
        elapsed = round(time() - queue.list_runs(job.id)[-1].started)
    done, total = status.get("done"), status.get("total")
    share = done / total if done is not None and total else None
    left = None
    if seconds and share is not None:  # by commands, which take different times
        left = round(seconds * (1 - share) * 100 / status.get("speed_percent", 100))
    return {
        "job": {
            "file": {
                "name": name,
                "path": name,
                "display": name,
                "size": size,
                "origin": "local",
                "date": None,
            },
            "estimatedPrintTime": seconds,
            "filament": None,
        },
        "progress": {
            "completion": None if share is None else round(100 * share, 2),
            "filepos": None,
            "printTime": elapsed,
            "printTimeLeft": left,
            "printTimeLeftOrigin": None if left is None else "estimate",
        },
        "state": describe_state(target)["text"],
    }
