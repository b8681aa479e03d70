"""Print a job over a serial port, with commands of users, Ctrl-C, a journal, and a checkpoint if it ends early."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from os import getpid
from pathlib import Path
from threading import Event as Flag
from threading import Thread, current_thread, main_thread
from time import monotonic, time_ns
from typing import TYPE_CHECKING, Any, Unpack, cast

from printer_slicer.deprecation import accept_former_option
from printer_slicer.diagnostics import raise_on_errors
from printer_slicer.errors import Cancelled, PortError, PrintError, UsageError
from printer_slicer.jobs import Job
from printer_slicer.printing import commands
from printer_slicer.printing import job_store as store
from printer_slicer.printing.controls import Controls, PrintOptions, PrintResult
from printer_slicer.printing.host_settings import HostSettings, host_settings_from
from printer_slicer.printing.job_store import Print
from printer_slicer.printing.journal import HEATERS_OFF, HOST, LOST, Journal, read_journal
from printer_slicer.printing.objects import LiveJob, find_object_spans
from printer_slicer.printing.print_controller import PrintController, Request
from printer_slicer.printing.reattach import (
    PrinterStateLost,
    ResumePlan,
    find_journal_damage,
    find_resume_plan,
    query_printer,
)
from printer_slicer.stream.events import Event, Finished, Halted, StreamWarning
from printer_slicer.stream.link_meter import LinkMeter, MeteredTransport
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import (
    PortInfo,
    SerialPort,
    find_device_of_board,
    find_port_info,
    open_port,
)
from printer_slicer.stream.session import run

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = [
    "PrintSession",
    "answering",
    "forget_checkpoint",
    "print_job",
    "resume_print",
    "run_heater_failsafe",
    "synced",
    "write_checkpoint",
]

# Ctrl-C and system shutdown.
_ENDS = (signal.SIGINT, signal.SIGTERM)
_OFF = "heaters and fan are off"
_LOOK = "Check the printer, its cable and its power; the part is not finished"
_LOOK_FOR_PORT = 0.5


def print_job(
    job: Job, profile: Profile | None, port: str, *, baud: int | None = None, **options: Unpack[PrintOptions]
) -> PrintResult:
    """Send a job to a printer, line by line, and wait until it has executed all of it.

    Args:
        job: the job.
        profile: profile of the printer; None: the profile of the job.
        port: device or pyserial URL.
        baud: baud rate; None: that of the profile.
        **options: `on_event` is called with each event. `checkpoint` is the file for the progress of a print that ends
            early. `controls` lets other threads pause, change and cancel the print. `job_store` is the folder for the
            data of a resume; without it the print cannot be resumed. With `discard`, an unfinished print on this port
            is deleted. `reconnect` is the time, s, to wait for a printer that was disconnected; it needs `job_store`.
            `dtr` is the level of the line that resets many boards; None: the default of the system. `allow` returns
            why a command typed by a user is rejected, empty if it is allowed. `guard` is the time, s, after which a
            second process switches the heaters off if this one has died and nobody has resumed the print; it needs
            `job_store`. When a print is aborted, the heaters are switched off, except with `guard` 0.

    Raises:
        PolicyError: the job has findings that are not allowed, see `Job.allowing`; nothing was sent.
        PortError: the port cannot be opened.
        UsageError: a print on this port is unfinished, or neither `profile` nor the job has a profile.
        PrintError: the printer stopped, or the connection was lost; the checkpoint is written.
        Cancelled: after Ctrl-C, SIGTERM or a request of the printer; the heaters are off. A second signal halts the
            printer. A closed terminal (SIGHUP) or output does not end the print.
    """
    accept_former_option(cast("dict[str, Any]", options), "shelf", "job_store")
    raise_on_errors(job.findings, job.allowed, name=job.name)
    setup = host_settings_from(job.require_profile(profile), job.allowed)
    speed = baud or setup.baud
    job_store = options.get("job_store")
    if job_store is not None:
        _reject_unfinished(job_store, port, discard=options.get("discard", False))
    transport = open_port(port, speed, dtr=options.get("dtr"))
    print_ = None
    try:
        if job_store is not None:
            print_ = store.begin(job_store, job.name, job.text, store.PortAddress(port, speed), setup)
    except BaseException:
        transport.close()
        raise
    return PrintSession(job, setup, store.PortAddress(port, speed), print_, options).go(transport, None)


def resume_print(
    print_: store.Print,
    job: Job,
    *,
    port: str | None = None,
    recover: Callable[[str], bool] = lambda _: False,
    **options: Unpack[PrintOptions],
) -> PrintResult:
    """Resume an unfinished print.

    If the printer has kept its state, the print continues with the next line. Otherwise, with consent, the printer
    homes x and y, heats up, approaches from outside the part, and continues at the position where it stopped.

    Args:
        print_: the print from the job store.
        job: the job made from its text.
        port: current port of the printer; None: the port of the print.
        recover: called with the reason for a recovery and its steps; returns whether to do it.
        **options: as for `print_job`.

    Raises:
        As `print_job`; UsageError: another process prints it; PrintError: no consent to a recovery.
    """
    from printer_slicer.printing.recovery import plan_recovery  # noqa: PLC0415 - rarely needed

    _take(print_, job)
    place = store.PortAddress(port or print_.port, print_.baud)
    transport = None
    try:
        transport = open_port(place.port, place.baud, dtr=options.get("dtr"))
        session = PrintSession(job, print_.setup, place, print_, options)
        try:
            found = session.reattach(transport)
            found = replace(found, phase="returning" if found.waits else found.phase)
        except PrinterStateLost as lost:
            plan = plan_recovery(print_, job)
            if not recover(f"the printer has lost its state: {lost}.\n{plan.told}"):
                message = f"{job.name}: not resumed: {lost}"
                raise PrintError(
                    message, remedy="Use printer-slicer resume --recover to run the recovery steps above"
                ) from None
            found = plan
    except BaseException:
        if transport is not None:
            transport.close()
        print_.release()
        raise
    return session.go(transport, found)


def _take(print_: store.Print, job: Job) -> None:
    """Take over an unfinished print.

    Raises:
        UsageError: another process prints it, or its journal is invalid.
    """
    if not print_.hold():
        raise UsageError(f"{print_.name} is already running", remedy="Run printer-slicer control status")
    if why := find_journal_damage(read_journal(print_.folder), len(job.commands)):
        print_.release()
        raise store.DamagedPrint(print_.folder, "journal", why).error()


def _reject_unfinished(job_store: Path, port: str, *, discard: bool) -> None:
    """Reject a new print if one on this port is unfinished.

    Raises:
        UsageError: there is one.
    """
    while (left := store.unfinished(job_store, port)) is not None:
        if not discard:
            raise UsageError(
                f"{left.name}, started {left.begun} on this port, is unfinished",
                remedy="Run printer-slicer resume to continue it, or print --discard-unfinished to delete it",
            )
        left.forget()


def _nobody(_: Event) -> None:
    """Ignore an event."""


def _anything(_: bytes) -> str:
    """Allow any command."""
    return ""


class PrintSession:
    """One print from start to end, over any number of connections."""

    def __init__(
        self,
        job: Job,
        setup: HostSettings,
        place: store.PortAddress,
        print_: store.Print | None,
        options: PrintOptions,
    ) -> None:
        self._job, self._setup, self._print = job, setup, print_
        self._port, self._baud = place.port, place.baud
        self._on_event = options.get("on_event", _nobody)
        self._checkpoint = options.get("checkpoint")
        self._controls = options.get("controls") or Controls()
        self._reconnect, self._dtr = options.get("reconnect", 0.0), options.get("dtr")
        self._allow = options.get("allow", _anything)
        self._guard = options.get("guard")
        self._journal = Journal(print_.folder) if print_ else None
        self._meter = LinkMeter(setup.limits)
        self._spans = find_object_spans(job.text)
        self._board: PortInfo | None = None
        self._transport: SerialPort | None = None
        self._controller: PrintController | None = None
        self._streamer: Streamer | None = None
        self._done = 0
        self._interrupts = 0

    def go(self, transport: SerialPort, found: ResumePlan | None) -> PrintResult:
        """Print to the end.

        Args:
            transport: the open port.
            found: where to resume, None at the start.

        Raises:
            As `print_job`.
        """
        begun = monotonic()
        try:
            with self._signals(), self._run_services():
                self._connections(transport, found)
        except PortError as error:
            raise PrintError(self._stopped(str(error).splitlines()[0]), remedy=self._look()) from None
        except Exception as error:
            raise PrintError(self._stopped(f"{error!r}; {_OFF}"), remedy=self._look()) from error
        finally:
            self._close()
        end = self._finished()
        forget_checkpoint(self._checkpoint, self._job)
        return PrintResult(
            len(self._job.commands), monotonic() - begun, end.verified, self._meter.statistics()
        )

    def reattach(self, transport: SerialPort) -> ResumePlan:
        """Find out whether the printer has kept its state, and where to resume.

        Raises:
            PrinterStateLost: it has not.
            PortError: the connection is lost.
        """
        assert self._print is not None
        assert self._journal is not None
        if not self._print.same_boot:
            raise PrinterStateLost("the computer was restarted, and the end of the journal may be missing")
        journal_data = read_journal(self._print.folder)
        resync = query_printer(transport, monotonic, journal_data, self._journal)
        found = find_resume_plan(journal_data, resync, self._job.commands, self._spans, self._setup)
        last = resync.queries()[-1][0]
        self._journal.accepted(last, found.entries, monotonic())
        return found

    def _listen(self, event: Event) -> None:
        """Report an event; a listener that can no longer write is not called again."""
        try:
            self._on_event(event)
        except OSError:
            self._on_event = _nobody

    # Connections.

    def _connections(self, transport: SerialPort, found: ResumePlan | None) -> None:
        while True:
            try:
                self._connect(transport, found)
            except PortError as error:
                transport, found = self._again(error)
            else:
                return

    def _connect(self, transport: SerialPort, found: ResumePlan | None) -> None:
        """Stream over one connection until the end; if a listener fails, cancel the print first."""
        self._transport = transport
        self._board = find_port_info(self._port) or self._board
        live = found.job if found else LiveJob(self._job.commands, self._spans, flavour=self._setup.flavour)
        streamer = Streamer(
            live,
            limits=self._setup.limits,
            window_bytes=self._setup.window_bytes,
            baud=self._baud,
            handle_actions=False,
            first=found.entries if found else 0,
        )
        controller = PrintController(
            streamer, live, self._setup, journal=self._journal, listen=self._listen, allow=self._allow
        )
        self._controller, self._streamer = controller, streamer
        if self._journal:
            self._journal.state({HOST: f"{getpid()} {time_ns()}"})
            self._journal.epoch(streamer.acknowledged)
        if found and found.phase == "recovering" and self._journal:
            self._journal.state({"phase": "recovering", "recovering_at": found.point, HEATERS_OFF: ""})
        if found and found.phase == "cancelling":
            controller.submit(Request(commands.Cancel()))
        elif found and (found.parked or found.replay):
            controller.restore(found.parked, found.pushed, found.replay, waits=found.waits)
        self._controls.bind(controller, transport.wake)
        try:
            self._run(controller)
            self._switch_off(controller)
        except PortError:
            raise
        except Exception:
            controller.stop_reporting()
            controller.cancel()
            self._run(controller)
            raise

    def _switch_off(self, controller: PrintController) -> None:
        """Switch the heaters off after an aborted print, if they may be on."""
        given_up = isinstance(controller.ended, Halted) and not controller.halted and self._guard != 0
        if not given_up or self._transport is None or self._streamer is None:
            return
        words = controller.watchdog.shutdown_lines(self._job.commands[: self._streamer.taken])
        if not words:
            return
        if self._journal:
            self._journal.state({HEATERS_OFF: "the print was aborted"})
        with suppress(PortError):
            self._transport.write(words)

    def _run(self, controller: PrintController) -> None:
        """Run the stream; interruptions become commands."""
        assert self._streamer is not None
        assert self._transport is not None
        cable = MeteredTransport(self._transport, self._meter, monotonic)

        def hear(event: Event) -> None:
            """Pass an event and the warnings of the link meter to the controller."""
            self._meter.on_event(event)
            for one in (event, *self._meter.new_warnings()):
                controller.hear(one)

        while True:
            try:
                run(
                    self._streamer,
                    cable,
                    monotonic,
                    on_event=hear,
                    before_send=controller.before_send,
                    record=controller.record,
                )
            except KeyboardInterrupt:
                self._interrupt()
            else:
                return

    def _again(self, error: PortError) -> tuple[SerialPort, ResumePlan]:
        """Wait until the printer is connected again, and reattach to it.

        Raises:
            PortError: it does not reconnect, or it has lost its state.
        """
        self._controls.bind(None, waits_for=f"the printer to reconnect: {str(error).splitlines()[0]}")
        self._done = self._streamer.acknowledged if self._streamer else self._done
        if self._transport is not None:
            self._transport.close()
        if self._print is None or self._journal is None:
            raise error
        reason = str(error).splitlines()[0]
        self._journal.ended(f"{LOST}{reason}", monotonic())
        if not self._reconnect or self._journal.failed:
            raise error
        self._listen(StreamWarning(f"{reason}: waiting {self._reconnect:g} s for the printer to reconnect"))
        transport = self._wait_for_port(error)
        try:
            found = self.reattach(transport)
        except PrinterStateLost as lost:
            transport.close()
            raise PortError(
                f"{reason}; reconnected, but {lost}", remedy="Run printer-slicer resume"
            ) from None
        self._listen(
            StreamWarning(f"reconnected: the printer has kept its state after {found.entries} commands")
        )
        return transport, found

    def _wait_for_port(self, error: PortError) -> SerialPort:
        give_up = monotonic() + self._reconnect
        while monotonic() < give_up and not self._controls.has_end_request and not self._interrupts:
            self._controls.requested.wait(_LOOK_FOR_PORT)
            self._controls.requested.clear()
            address = (find_device_of_board(self._board) if self._board else "") or self._port
            with suppress(PortError):
                transport = open_port(address, self._baud, dtr=self._dtr)
                self._port = address
                return transport
        raise error

    # Signals and background services.

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """Count signals instead of being interrupted by them; only the main thread receives any."""
        if current_thread() is not main_thread():
            yield
            return
        handlers: dict[int, Any] = dict.fromkeys(_ENDS, self._on_signal)
        if hasattr(signal, "SIGHUP"):  # the terminal is closed: the print continues, and `control` reaches it
            handlers[signal.SIGHUP] = signal.SIG_IGN
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self._interrupt()

    def _interrupt(self) -> None:
        """Cancel the print on the first signal; halt the printer on the second."""
        self._interrupts += 1
        if self._controller is not None:
            self._controller.submit(Request(commands.Cancel() if self._interrupts == 1 else commands.Stop()))
        if self._transport is not None:
            self._transport.wake()

    @contextmanager
    def _run_services(self) -> Iterator[None]:
        """Run the background services of a stored print."""
        if self._print is None or self._journal is None:
            yield
            return
        with (
            synced(self._journal),
            answering(self._print, self._controls),
            run_heater_failsafe(self._print, self._guard or 0.0),
        ):
            yield

    # End of the print.

    def _close(self) -> None:
        self._controls.bind(None)
        if self._transport is not None:
            self._transport.close()

    def _finished(self) -> Finished:
        """Return the end of a completed print, or raise the error of another end."""
        controller = self._controller
        assert controller is not None
        end = controller.ended
        if isinstance(end, Finished):
            if not end.cancelled:
                self._leave(keep=False, reason="done")
                return end
            raise Cancelled(self._stopped(f"cancelled, {_OFF}", keep=False))
        assert isinstance(end, Halted)
        kind = Cancelled if controller.end_requests else PrintError
        raise kind(self._stopped(end.reason), remedy=self._look())

    def _look(self) -> str:
        return _LOOK if self._print is None else f"{_LOOK}. Run printer-slicer resume to continue"

    def _leave(self, *, keep: bool, reason: str) -> None:
        """Close the journal, and keep it only if the print can be resumed."""
        if self._journal is not None:
            self._journal.ended(reason, monotonic())
            self._journal.close()
        if self._print is not None:
            if keep:
                self._print.release()
            else:
                self._print.forget()

    def _stopped(self, reason: str, *, keep: bool = True) -> str:
        """Write the checkpoint; say why and where the print stopped."""
        done = self._streamer.acknowledged if self._streamer else self._done
        self._leave(keep=keep and done > 0, reason=reason)
        return write_checkpoint(self._job, done, self._checkpoint, reason)


def forget_checkpoint(checkpoint: Path | None, job: Job) -> None:
    """Delete the checkpoint of a completed print, also that of an earlier try."""
    with suppress(OSError, ValueError, TypeError, KeyError):  # a stale checkpoint does no harm
        if checkpoint is not None and json.loads(checkpoint.read_bytes())["job"] == job.name:
            checkpoint.unlink()


def write_checkpoint(job: Job, done: int, checkpoint: Path | None, reason: str) -> str:
    """Write a checkpoint with the number of accepted job entries; return the same as text."""
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


_SYNC = 1.0
"""Interval at which the journal is synced to disk, s."""


@contextmanager
def synced(journal: Journal) -> Iterator[None]:
    """Sync the journal to disk once a second, in a thread that delays no line."""
    stop = Flag()

    def work() -> None:
        """Sync until the print has ended."""
        while not stop.wait(_SYNC):
            journal.sync()

    thread = Thread(target=work, name="journal", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextmanager
def answering(print_: Print, controls: Controls) -> Iterator[None]:
    """Let other processes of this user control the print."""
    from printer_slicer.printing.control_socket import serve_control  # noqa: PLC0415 - sockets are only needed here

    with serve_control(print_.folder, controls, print_.name):
        yield


@contextmanager
def run_heater_failsafe(print_: Print, seconds: float) -> Iterator[None]:
    """Switch the heaters off if this process dies and nobody resumes the print within `seconds`; 0: leave them on."""
    if seconds <= 0:
        yield
        return
    from printer_slicer.printing.heater_failsafe import failsafe_process  # noqa: PLC0415 - another process is only needed here

    with failsafe_process(print_.folder, seconds):
        yield
