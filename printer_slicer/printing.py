"""Print a job over a serial port: progress, Ctrl-C, and a checkpoint when it does not come to its end."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import monotonic

from printer_slicer.errors import Cancelled, PortError, PrintError
from printer_slicer.jobs import Job
from printer_slicer.motion.machine import limits_of
from printer_slicer.profile import Profile
from printer_slicer.stream.events import Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import open_port
from printer_slicer.stream.session import run
from printer_slicer.stream.transport import Transport

__all__ = ["Done", "print_job"]

# What makes a machine safe that was stopped in the middle: heaters and fan off, nozzle off the part, motors free.
_STOP_SCRIPT = (b"M104 S0", b"M140 S0", b"M107", b"G91", b"G1 Z5 F300", b"G90", b"M84")

_LOOK = "look at the printer, its cable and its power before you go on; the part is not finished"


@dataclass(frozen=True, slots=True)
class Done:
    """A print that came to its end.

    Attributes:
        commands: of the job, all acknowledged.
        seconds: from the first byte to the last answer.
        verified: the printer says that it is where the job ends; None where it cannot be compared.
    """

    commands: int
    seconds: float
    verified: bool | None


def print_job(
    job: Job,
    profile: Profile,
    port: str,
    *,
    baud: int | None = None,
    on_event: Callable[[Event], None] = lambda _: None,
    checkpoint: Path | None = None,
) -> Done:
    """Send a job to a printer, line by line, and wait until it has executed all of it.

    Args:
        job: what to print.
        profile: the printer part gives limits, baud rate and the size of the receive buffer.
        port: device or pyserial URL.
        baud: None takes the profile's.
        on_event: is told what happens.
        checkpoint: where to write how far the print came, if it does not come to its end.

    Raises:
        PortError: the port cannot be opened.
        PrintError: the printer stopped, or the port went away; the checkpoint is written.
        Cancelled: Ctrl-C; heaters are off and the checkpoint is written. A second Ctrl-C halts the printer (M112),
            which is a PrintError.
    """
    printer = profile.printer
    streamer = Streamer(job.commands, limits=limits_of(printer), window_bytes=printer.receive_buffer - 1)
    ends: list[Finished | Halted] = []

    def listen(event: Event) -> None:
        if isinstance(event, (Finished, Halted)):
            ends.append(event)
        on_event(event)

    begun = monotonic()
    transport = open_port(port, baud or printer.baud)
    try:
        _run_until_stopped(streamer, transport, listen)
    except PortError as error:
        reason = str(error).splitlines()[0]
        raise PrintError(_stopped(job, streamer, reason, checkpoint), remedy=_LOOK) from None
    finally:
        transport.close()
    end = ends[-1]
    if isinstance(end, Halted):
        raise PrintError(_stopped(job, streamer, end.reason, checkpoint), remedy=_LOOK)
    if end.cancelled:
        raise Cancelled(_stopped(job, streamer, "cancelled; heaters and fan are off", checkpoint))
    return Done(len(job.commands), monotonic() - begun, end.verified)


def _run_until_stopped(streamer: Streamer, transport: Transport, listen: Callable[[Event], None]) -> None:
    """Stream to the end; the first Ctrl-C ends the print in good order, the second one at once."""
    try:
        run(streamer, transport, monotonic, on_event=listen)
    except KeyboardInterrupt:
        streamer.cancel(_STOP_SCRIPT)
        try:
            run(streamer, transport, monotonic, on_event=listen)
        except KeyboardInterrupt:
            streamer.emergency_stop()
            run(streamer, transport, monotonic, on_event=listen)


def _stopped(job: Job, streamer: Streamer, reason: str, checkpoint: Path | None) -> str:
    """Write the checkpoint; say why and where the print stopped."""
    done = streamer.acknowledged
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
