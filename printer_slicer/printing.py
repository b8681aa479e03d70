"""Print a job over a serial port: progress, Ctrl-C, and a checkpoint when it does not come to its end."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import current_thread, main_thread
from time import monotonic

from printer_slicer.errors import Cancelled, PortError, PrintError
from printer_slicer.jobs import Job
from printer_slicer.motion.machine import limits_of
from printer_slicer.policy import insist
from printer_slicer.profile import Profile
from printer_slicer.stream.events import Action, Event, Finished, Halted, Stopping
from printer_slicer.stream.link_meter import LinkMeter, LinkSeen, Metered
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import open_port
from printer_slicer.stream.session import run
from printer_slicer.stream.transport import Transport

__all__ = ["Done", "print_job"]

# What makes a machine safe that was stopped in the middle: heaters and fan off, nozzle off the part, motors free.
_STOP_SCRIPT = (b"M104 S0", b"M140 S0", b"M107", b"G91", b"G1 Z5 F300", b"G90", b"M84")

# Ctrl-C, a computer that shuts down, and a terminal that is closed (which Windows does not have).
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_OFF = "heaters and fan are off"
_LOOK = "look at the printer, its cable and its power before you go on; the part is not finished"


@dataclass(frozen=True, slots=True)
class Done:
    """A print that came to its end.

    Attributes:
        commands: of the job, all acknowledged.
        seconds: from the first byte to the last answer.
        verified: the printer says that it is where the job ends; None where it cannot be compared.
        link: what the cable was like.
    """

    commands: int
    seconds: float
    verified: bool | None
    link: LinkSeen


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
        profile: on which printer.
        port: device or pyserial URL.
        baud: None takes the profile's.
        on_event: is told what happens.
        checkpoint: where to write how far the print came, if it does not come to its end.

    Raises:
        PolicyError: the job holds what was not allowed, see `Job.allowing`; nothing was sent.
        PortError: the port cannot be opened.
        PrintError: the printer stopped, or the port went away; the checkpoint is written.
        Cancelled: Ctrl-C, SIGTERM, SIGHUP or the printer's own wish; heaters are off. A second one halts the printer.
    """
    insist(job.findings, job.allowed, name=job.name)
    printer = profile.printer
    speed = baud or printer.baud
    window = printer.receive_buffer - 1
    streamer = Streamer(job.commands, limits=limits_of(printer), window_bytes=window, baud=speed)
    begun = monotonic()
    meter = LinkMeter(limits_of(printer))
    cable = Metered(open_port(port, speed), meter, monotonic)
    transport = _Interruptible(cable, streamer, _both(meter.heard, on_event))
    stopped = partial(_stopped, job, streamer, checkpoint)
    try:
        with transport.signals():
            _run(streamer, transport)
    except PortError as error:
        raise PrintError(stopped(str(error).splitlines()[0]), remedy=_LOOK) from None
    except Exception as error:
        why = "nobody reads the output any more" if isinstance(error, BrokenPipeError) else repr(error)
        raise PrintError(stopped(f"{why}; {_OFF}")) from error
    finally:
        transport.close()
    end = _finished(transport, stopped)
    _forget(checkpoint, job)
    return Done(len(job.commands), monotonic() - begun, end.verified, meter.seen())


def _both(first: Callable[[Event], None], second: Callable[[Event], None]) -> Callable[[Event], None]:
    """A listener that tells two others."""

    def hear(event: Event) -> None:
        """Tell both."""
        first(event)
        second(event)

    return hear


def _forget(checkpoint: Path | None, job: Job) -> None:
    """A print that came to its end leaves no checkpoint, nor that of an earlier try."""
    with suppress(OSError, ValueError, TypeError, KeyError):  # the print is good all the same
        if checkpoint is not None and json.loads(checkpoint.read_bytes())["job"] == job.name:
            checkpoint.unlink()


def _finished(transport: _Interruptible, stopped: Callable[[str], str]) -> Finished:
    """The end of a print that was neither halted nor cancelled."""
    end = transport.end
    if isinstance(end, Finished) and not end.cancelled:
        return end
    if isinstance(end, Halted):
        raise (Cancelled if transport.wishes else PrintError)(stopped(end.reason), remedy=_LOOK)
    raise Cancelled(stopped(f"cancelled, {_OFF}"))


def _run(streamer: Streamer, transport: _Interruptible) -> None:
    """Stream to the end; if a listener fails, end the print in good order before passing that on."""
    try:
        _run_to_the_end(streamer, transport, transport.hear)
    except PortError:
        raise
    except Exception:
        streamer.cancel(_STOP_SCRIPT)
        _run_to_the_end(streamer, transport, lambda _: None)
        raise


def _run_to_the_end(streamer: Streamer, transport: _Interruptible, listen: Callable[[Event], None]) -> None:
    """Run on through interruptions: they are wishes like the signals."""
    while True:
        try:
            run(streamer, transport, monotonic, on_event=listen)
        except KeyboardInterrupt:
            transport.wishes += 1
        else:
            return


class _Interruptible:
    """A transport during whose reads the wishes of Ctrl-C and SIGTERM are granted, never in the middle of other work.

    The first one ends the print in good order, the second one halts the printer at once.
    """

    def __init__(self, inner: Transport, streamer: Streamer, listen: Callable[[Event], None]) -> None:
        self._inner = inner
        self._listen = listen
        self._streamer = streamer
        self._granted = 0
        self.wishes = 0

    @contextmanager
    def signals(self) -> Iterator[None]:
        """Count the signals instead of being interrupted by them; only the main thread gets any."""
        if current_thread() is not main_thread():
            yield
            return
        before = {number: signal.signal(number, self._wish) for number in _SIGNALS}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def hear(self, event: Event) -> None:
        """Take note of what ends the print, or asks for its end, and pass it on."""
        if isinstance(event, Finished | Halted):
            self.end = event
        if isinstance(event, Action) and event.name == "cancel":
            self.wishes += 1
        self._listen(event)

    def _wish(self, _number: int, _frame: object) -> None:
        self.wishes += 1

    def write(self, data: bytes) -> None:
        """Hand over all bytes."""
        self._inner.write(data)

    def read(self, timeout: float) -> bytes:
        """What has come, after granting the wishes that came in the meantime."""
        data = self._inner.read(timeout)
        while self._granted < self.wishes:
            self._granted += 1
            if self._granted == 1:
                self._streamer.cancel(_STOP_SCRIPT)
                self._listen(Stopping())
            else:
                self._streamer.emergency_stop()
        return data

    def close(self) -> None:
        """Let go of the port."""
        self._inner.close()


def _stopped(job: Job, streamer: Streamer, checkpoint: Path | None, reason: str) -> str:
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
