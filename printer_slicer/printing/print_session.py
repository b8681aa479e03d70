"""Print a job over a serial port, with control by users and Ctrl-C, a journal, and a checkpoint if it ends early."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from os import getpid
from pathlib import Path
from threading import Event as Flag
from threading import Thread, current_thread, main_thread
from time import monotonic, time_ns
from types import NoneType
from typing import TYPE_CHECKING, Any, Unpack, cast

from printer_slicer.arguments import check_arguments
from printer_slicer.deprecation import accept_former_option
from printer_slicer.diagnostics import raise_on_errors
from printer_slicer.errors import Cancelled, PortError, PrintError, UsageError
from printer_slicer.jobs import Job
from printer_slicer.printing import commands
from printer_slicer.printing import job_store as store
from printer_slicer.printing.controls import Controls, PrintOptions, PrintResult
from printer_slicer.printing.host_settings import HostSettings, make_host_settings
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
from printer_slicer.printing.status_feed import StatusFeed
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
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = [
    "PrintSession",
    "delete_checkpoint",
    "print_job",
    "resume_print",
    "run_heater_failsafe",
    "serve_controls",
    "sync_journal",
    "write_checkpoint",
]

# Ctrl-C and system shutdown.
_END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_HEATERS_OFF_TEXT = "heaters and fan are off"
_CHECK_REMEDY = "Check the printer, its cable and its power; the part is not finished"
_PORT_POLL_INTERVAL = 0.5


@check_arguments(job=Job, port=str, baud=(int, NoneType))
def print_job(
    job: Job, profile: Profile | None, port: str, *, baud: int | None = None, **options: Unpack[PrintOptions]
) -> PrintResult:
    """Send a job to a printer, line by line, and wait until it has executed all of it.

    Args:
        job: the job.
        profile: profile of the printer; None: the profile of the job.
        port: device or pyserial URL.
        baud: baud rate; None: that of the profile.
        **options: `on_event` is called with each event. `checkpoint` is the file that records the progress if the print
            ends early. `controls` lets other threads pause, change and cancel the print. `job_store` is the folder for
            the data of a resume; without it the print cannot be resumed. With `discard`, an unfinished print on this
            port is deleted. `reconnect` is the time, s, to wait for a printer that was disconnected; it needs
            `job_store`. `dtr` is the level of the line that resets many boards; None: the default of the system.
            `allow` returns why a command typed by a user is rejected, empty if it is allowed. `guard` is the time, s,
            after which a second process switches the heaters off if this one has died and nobody has resumed the print;
            it needs `job_store`. When a print is aborted, the heaters are switched off, except with `guard` 0.
            `folder_name` names the print's folder in `job_store`; `on_ready` gets it before the first byte is sent.

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
    setup = make_host_settings(job.require_profile(profile), job.allowed)
    speed = baud or setup.baud
    job_store = options.get("job_store")
    if job_store is not None:
        _reject_unfinished_print(job_store, port, discard=options.get("discard", False))
    transport = open_port(port, speed, dtr=options.get("dtr"))
    print_ = None
    try:
        if job_store is not None:
            address = store.PortAddress(port, speed)
            folder_name = options.get("folder_name", "")
            print_ = store.create_print(
                job_store, job.name, job.text, address, setup, folder_name=folder_name
            )
    except BaseException:
        transport.close()
        raise
    return PrintSession(job, setup, store.PortAddress(port, speed), print_, options).print_to_end(
        transport, None
    )


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
        As `print_job`; UsageError: another process is printing it; PrintError: the recovery was declined.
    """
    from printer_slicer.printing.recovery import plan_recovery  # noqa: PLC0415 - rarely needed

    _lock_unfinished_print(print_, job)
    address = store.PortAddress(port or print_.port, print_.baud)
    transport = None
    try:
        transport = open_port(address.port, address.baud, dtr=options.get("dtr"))
        session = PrintSession(job, print_.setup, address, print_, options)
        try:
            found = session.reattach(transport)
            found = replace(found, phase="returning" if found.is_paused else found.phase)
        except PrinterStateLost as lost:
            plan = plan_recovery(print_, job)
            if not recover(f"the printer has lost its state: {lost}.\n{plan.steps}"):
                message = f"{job.name} was not resumed: {lost}"
                raise PrintError(
                    message, remedy="Use printer-slicer resume --recover to run the recovery steps above"
                ) from None
            found = plan
    except BaseException:
        if transport is not None:
            transport.close()
        print_.release()
        raise
    return session.print_to_end(transport, found)


def _lock_unfinished_print(print_: store.Print, job: Job) -> None:
    """Lock an unfinished print for this process, and check its journal.

    Raises:
        UsageError: another process is printing it, or its journal is damaged.
    """
    if not print_.lock():
        raise UsageError(f"{print_.name} is already running", remedy="Run printer-slicer control status")
    if why := find_journal_damage(read_journal(print_.folder), len(job.commands)):
        print_.release()
        raise store.DamagedPrint(print_.folder, "journal", why).make_error()


def _reject_unfinished_print(job_store: Path, port: str, *, discard: bool) -> None:
    """Raise an error if a print on this port is unfinished; with `discard`, delete that print instead.

    Raises:
        UsageError: a print on this port is unfinished.
    """
    while (left := store.find_unfinished_print(job_store, port)) is not None:
        if not discard:
            raise UsageError(
                f"{left.name}, started {left.begun} on this port, is unfinished",
                remedy="Run printer-slicer resume to continue that print, or print --discard-unfinished to delete it",
            )
        left.delete()


def _ignore_event(_: Event) -> None:
    """Ignore an event, if there is no listener."""


def _ignore_folder(_: Path) -> None:
    """Ignore the folder of a print that is ready."""


def _allow_any_command(_: bytes) -> str:
    """Allow any command."""
    return ""


class PrintSession:
    """Runs one print from start to end, and reconnects to the printer if the connection is lost."""

    def __init__(
        self,
        job: Job,
        setup: HostSettings,
        address: store.PortAddress,
        print_: store.Print | None,
        options: PrintOptions,
    ) -> None:
        self._job, self._setup, self._print = job, setup, print_
        self._port, self._baud = address.port, address.baud
        self._on_event = options.get("on_event", _ignore_event)
        self._checkpoint = options.get("checkpoint")
        self._controls = options.get("controls") or Controls()
        self._reconnect, self._dtr = options.get("reconnect", 0.0), options.get("dtr")
        self._allow = options.get("allow", _allow_any_command)
        self._guard = options.get("guard")
        self._on_ready = options.get("on_ready", _ignore_folder)
        self._feed = StatusFeed(self._read_status)
        self._journal = Journal(print_.folder) if print_ else None
        self._meter = LinkMeter(setup.limits)
        self._spans = find_object_spans(job.text)
        self._board: PortInfo | None = None
        self._transport: SerialPort | None = None
        self._controller: PrintController | None = None
        self._streamer: Streamer | None = None
        self._done = 0
        self._interrupts = 0

    def print_to_end(self, transport: SerialPort, plan: ResumePlan | None) -> PrintResult:
        """Print until the job ends, and return the result.

        Args:
            transport: the open port.
            plan: where to resume; None: at the start.

        Raises:
            As `print_job`.
        """
        begun = monotonic()
        try:
            with self._handle_signals(), self._run_background_services():
                self._stream_until_end(transport, plan)
        except PortError as error:
            raise PrintError(
                self._record_stop(str(error).splitlines()[0]), remedy=self._make_remedy()
            ) from None
        except Exception as error:
            raise PrintError(
                self._record_stop(f"{error!r}; {_HEATERS_OFF_TEXT}"), remedy=self._make_remedy()
            ) from error
        finally:
            self._close_port()
        end = self._require_completion()
        delete_checkpoint(self._checkpoint, self._job)
        return PrintResult(
            len(self._job.commands), monotonic() - begun, end.verified, self._meter.statistics()
        )

    def reattach(self, transport: SerialPort) -> ResumePlan:
        """Query a printer that was connected before, and return the plan of the resume.

        Raises:
            PrinterStateLost: the printer has not kept its state.
            PortError: the connection is lost.
        """
        assert self._print is not None
        assert self._journal is not None
        if not self._print.is_same_boot:
            raise PrinterStateLost("the computer was restarted, and the end of the journal may be missing")
        journal_data = read_journal(self._print.folder)
        resync = query_printer(transport, monotonic, journal_data, self._journal)
        found = find_resume_plan(journal_data, resync, self._job.commands, self._spans, self._setup)
        last = resync.queries()[-1][0]
        self._journal.record_accepted(last, found.entries, monotonic())
        return found

    def _notify_listener(self, event: Event) -> None:
        """Send an event to the watchers and the listener; drop a listener whose output is closed."""
        self._feed.on_event(event)
        try:
            self._on_event(event)
        except OSError:
            self._on_event = _ignore_event

    def _read_status(self) -> dict[str, Any]:
        """Return the status for watchers; called on another thread."""
        status = self._controls.read_status()
        layer = self._job.layer_of(status.get("done", 0))
        return status | {"layer": layer, "layers": self._job.last_layer}

    # Connections.

    def _stream_until_end(self, transport: SerialPort, plan: ResumePlan | None) -> None:
        """Stream until the print ends, and reconnect if the connection is lost."""
        while True:
            try:
                self._stream_over_connection(transport, plan)
            except PortError as error:
                transport, plan = self._wait_and_reattach(error)
            else:
                return

    def _stream_over_connection(self, transport: SerialPort, plan: ResumePlan | None) -> None:
        """Stream over one connection until the end; an error in the listener cancels the print."""
        self._transport = transport
        self._board = find_port_info(self._port) or self._board
        live = plan.job if plan else LiveJob(self._job.commands, self._spans, flavour=self._setup.flavour)
        streamer = Streamer(
            live,
            limits=self._setup.limits,
            window_bytes=self._setup.window_bytes,
            baud=self._baud,
            handle_actions=False,
            first=plan.entries if plan else 0,
        )
        controller = PrintController(
            streamer,
            live,
            self._setup,
            journal=self._journal,
            listen=self._notify_listener,
            allow=self._allow,
        )
        self._controller, self._streamer = controller, streamer
        if self._journal:
            self._journal.record_state({HOST: f"{getpid()} {time_ns()}"})
            self._journal.record_restart(streamer.acknowledged)
        if plan and plan.phase == "recovering" and self._journal:
            self._journal.record_state({"phase": "recovering", "recovering_at": plan.point, HEATERS_OFF: ""})
        if plan and plan.phase == "cancelling":
            controller.submit(Request(commands.Cancel()))
        elif plan and (plan.parked or plan.replay):
            controller.restore_print(plan.parked, plan.extruded, plan.replay, stays_paused=plan.is_paused)
        self._controls.bind(controller, transport.wake)
        try:
            self._run_streamer(controller)
            self._switch_heaters_off(controller)
        except PortError:
            raise
        except Exception:
            controller.stop_reporting()
            controller.cancel()
            self._run_streamer(controller)
            raise

    def _switch_heaters_off(self, controller: PrintController) -> None:
        """Switch the heaters off after an aborted print, except after an emergency stop."""
        given_up = isinstance(controller.ended, Halted) and not controller.halted and self._guard != 0
        if not given_up or self._transport is None or self._streamer is None:
            return
        words = controller.watchdog.build_shutdown_lines(self._job.commands[: self._streamer.n_entries_taken])
        if not words:
            return
        if self._journal:
            self._journal.record_state({HEATERS_OFF: "the print was aborted"})
        with suppress(PortError):
            self._transport.write(words)

    def _run_streamer(self, controller: PrintController) -> None:
        """Run the streamer; Ctrl-C cancels the print, and a second Ctrl-C halts the printer."""
        assert self._streamer is not None
        assert self._transport is not None
        metered = MeteredTransport(self._transport, self._meter, monotonic)

        def on_event(event: Event) -> None:
            """Pass an event and the warnings of the link meter to the controller."""
            self._meter.on_event(event)
            for one in (event, *self._meter.find_new_warnings()):
                controller.on_event(one)

        while True:
            try:
                run(
                    self._streamer,
                    metered,
                    monotonic,
                    on_event=on_event,
                    before_send=controller.advance,
                    record=controller.record_events,
                )
            except KeyboardInterrupt:
                self._cancel_or_halt()
            else:
                return

    def _wait_and_reattach(self, error: PortError) -> tuple[SerialPort, ResumePlan]:
        """Wait until the printer is connected again; return the port, and the plan of the resume.

        Raises:
            PortError: the printer is not connected again in time, or it has lost its state.
        """
        self._controls.bind(None, waits_for=f"the printer to reconnect: {str(error).splitlines()[0]}")
        self._done = self._streamer.acknowledged if self._streamer else self._done
        if self._transport is not None:
            self._transport.close()
        if self._print is None or self._journal is None:
            raise error
        reason = str(error).splitlines()[0]
        self._journal.record_end(f"{LOST}{reason}", monotonic())
        if not self._reconnect or self._journal.failure:
            raise error
        self._notify_listener(
            StreamWarning(f"{reason}: waiting {self._reconnect:g} s for the printer to reconnect")
        )
        transport = self._wait_for_port(error)
        try:
            plan = self.reattach(transport)
        except PrinterStateLost as lost:
            transport.close()
            raise PortError(
                f"{reason}; reconnected, but {lost}", remedy="Run printer-slicer resume"
            ) from None
        self._notify_listener(
            StreamWarning(f"reconnected: the printer has kept its state after {plan.entries} commands")
        )
        return transport, plan

    def _wait_for_port(self, error: PortError) -> SerialPort:
        """Wait until the port can be opened again; raise `error` if the time is up."""
        give_up = monotonic() + self._reconnect
        while monotonic() < give_up and not self._controls.has_end_request and not self._interrupts:
            self._controls.requested.wait(_PORT_POLL_INTERVAL)
            self._controls.requested.clear()
            address = (find_device_of_board(self._board) if self._board else "") or self._port
            with suppress(PortError):
                transport = open_port(address, self._baud, dtr=self._dtr)
                self._port = address
                return transport
        raise error

    # Signals and background services.

    @contextmanager
    def _handle_signals(self) -> Iterator[None]:
        """Let signals cancel the print within a `with` block; only the main thread receives signals."""
        if current_thread() is not main_thread():
            yield
            return
        handlers: dict[int, Any] = dict.fromkeys(_END_SIGNALS, self._on_signal)
        # When the terminal is closed, the print continues and can be controlled by `control`.
        if hasattr(signal, "SIGHUP"):
            handlers[signal.SIGHUP] = signal.SIG_IGN
        before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self._cancel_or_halt()

    def _cancel_or_halt(self) -> None:
        """Cancel the print on the first signal; halt the printer on the second."""
        self._interrupts += 1
        if self._controller is not None:
            self._controller.submit(Request(commands.Cancel() if self._interrupts == 1 else commands.Abort()))
        if self._transport is not None:
            self._transport.wake()

    @contextmanager
    def _run_background_services(self) -> Iterator[None]:
        """Run the background services of a stored print within a `with` block."""
        if self._print is None or self._journal is None:
            yield
            return
        with (
            sync_journal(self._journal),
            serve_controls(self._print, self._controls, self._feed),
            run_heater_failsafe(self._print, self._guard or 0.0),
        ):
            self._on_ready(self._print.folder)
            yield

    # End of the print.

    def _close_port(self) -> None:
        """Disconnect the controls, and close the port."""
        self._controls.bind(None)
        if self._transport is not None:
            self._transport.close()

    def _require_completion(self) -> Finished:
        """Return the last event of the print; raise an error if the print was not completed."""
        controller = self._controller
        assert controller is not None
        end = controller.ended
        if isinstance(end, Finished):
            if not end.cancelled:
                self._close_journal(keep=False, reason="done")
                return end
            raise Cancelled(self._record_stop(f"cancelled, {_HEATERS_OFF_TEXT}", keep=False))
        assert isinstance(end, Halted)
        kind = Cancelled if controller.end_requests else PrintError
        raise kind(self._record_stop(end.reason), remedy=self._make_remedy())

    def _make_remedy(self) -> str:
        """Return the remedy for a print that ended early."""
        resume = "" if self._print is None else ". Run printer-slicer resume to continue"
        return _CHECK_REMEDY + resume

    def _close_journal(self, *, keep: bool, reason: str) -> None:
        """Close the journal; release the stored print with `keep`, otherwise delete it."""
        if self._journal is not None:
            self._journal.record_end(reason, monotonic())
            self._journal.close()
        if self._print is not None:
            if keep:
                self._print.release()
            else:
                self._print.delete()

    def _record_stop(self, reason: str, *, keep: bool = True) -> str:
        """Close the journal and write the checkpoint; return a message that says why and where the print stopped."""
        done = self._streamer.acknowledged if self._streamer else self._done
        self._close_journal(keep=keep and done > 0, reason=reason)
        return write_checkpoint(self._job, done, self._checkpoint, reason)


def delete_checkpoint(checkpoint: Path | None, job: Job) -> None:
    """Delete the checkpoint file of a completed print, even if an earlier attempt wrote the file."""
    with suppress(OSError, ValueError, TypeError, KeyError):  # a stale checkpoint does no harm
        if checkpoint is not None and json.loads(checkpoint.read_bytes())["job"] == job.name:
            checkpoint.unlink()


def write_checkpoint(job: Job, done: int, checkpoint: Path | None, reason: str) -> str:
    """Write a checkpoint; return a message that says why and where the print stopped.

    Args:
        job: the job.
        done: number of accepted job entries.
        checkpoint: file to write; None: only return the message.
        reason: why the print stopped.
    """
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
        return f"{message}; the checkpoint {checkpoint.absolute()} could not be written: {error.strerror}"
    return f"{message}; checkpoint: {checkpoint.absolute()}"


_SYNC_INTERVAL = 1.0
"""Interval at which the journal is synced to disk, s."""


@contextmanager
def sync_journal(journal: Journal) -> Iterator[None]:
    """Sync the journal to disk once a second within a `with` block, in a separate thread."""
    stop = Flag()

    def sync_repeatedly() -> None:
        """Sync until the print has ended."""
        while not stop.wait(_SYNC_INTERVAL):
            journal.sync()

    thread = Thread(target=sync_repeatedly, name="journal", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@contextmanager
def serve_controls(print_: Print, controls: Controls, feed: StatusFeed | None = None) -> Iterator[None]:
    """Let other processes of this user control and watch the print within a `with` block."""
    from printer_slicer.printing.control_socket import serve_control_socket  # noqa: PLC0415 - sockets are only needed here

    with serve_control_socket(print_.folder, controls, print_.name, feed):
        try:
            yield
        finally:
            if feed is not None:
                feed.close()


@contextmanager
def run_heater_failsafe(print_: Print, seconds: float) -> Iterator[None]:
    """Run the heater failsafe process within a `with` block, unless `seconds` is 0.

    Args:
        print_: the print to watch.
        seconds: time for a new host to resume the print.
    """
    if seconds <= 0:
        yield
        return
    from printer_slicer.printing.heater_failsafe import run_failsafe_process  # noqa: PLC0415 - another process is only needed here

    with run_failsafe_process(print_.folder, seconds):
        yield
