"""The checkpoint: a small file beside the job that says how far a print came that was not finished."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path

from printer_slicer.jobs import Job

__all__ = ["forget_checkpoint", "write_checkpoint"]


def forget_checkpoint(checkpoint: Path | None, job: Job) -> None:
    """A print that came to its end leaves no checkpoint, nor that of an earlier try."""
    with suppress(OSError, ValueError, TypeError, KeyError):  # the print is good all the same
        if checkpoint is not None and json.loads(checkpoint.read_bytes())["job"] == job.name:
            checkpoint.unlink()


def write_checkpoint(job: Job, done: int, checkpoint: Path | None, reason: str) -> str:
    """Write how far a print came, so many entries of the job; the same in words."""
    layer = job.layer_of(done)
    where = f"after {done} of {len(job.commands)} commands" + (f", in layer {layer}" if layer else "")
    message = f"{job.name}: {reason} ({where})"
    if checkpoint is None:
        return message
    state = {
        "job": job.name,
        "reason": reason,
        "acknowledged": done,
        "commands": len(job.commands),
        "layer": layer,
    }
    if done < len(job.commands):
        state["next"] = job.commands[done].decode("latin-1")
    try:
        checkpoint.write_text(json.dumps(state, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        return f"{message}; the checkpoint {checkpoint} could not be written: {error.strerror}"
    return f"{message}; checkpoint: {checkpoint}"
