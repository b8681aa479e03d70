"""Print one run of the queue: `python -m printer_slicer.print_queue.run_print FOLDER`.

The process locks the folder, claims it before it opens the port, and writes at its end how the print ended.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.errors import Cancelled, PolicyError, PortError, PrintError, PrinterSlicerError
from printer_slicer.print_queue.printers import PrinterEntry
from printer_slicer.print_queue.run_folder import (
    READY_FILE,
    RunInstructions,
    RunResult,
    is_end_requested,
    lock_run,
    read_instructions,
    try_to_claim,
    write_result,
)
from printer_slicer.saving import save

if TYPE_CHECKING:
    from printer_slicer.inspection.dry_run.comparison import Comparison
    from printer_slicer.jobs import Job
    from printer_slicer.printing import PrintResult
    from printer_slicer.profile import Profile

__all__ = ["main", "run_print"]

_NICENESS: Final = -10
_PORT_LINK: Final = "port"
_SIMULATION_FILE: Final = "simulation.json"


def main(words: list[str]) -> int:
    """Print the run in the folder that is the only argument; return the exit code."""
    return run_print(Path(words[0]))


def _raise_priority() -> None:
    """Let this process go before others, so that a busy computer does not delay the port; only some users may."""
    if os.name == "posix":
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)


def run_print(folder: Path) -> int:
    """Print the run in a folder; return the exit code.

    Returns:
        0 if the print is done or somebody else has claimed the run, otherwise the exit code of its error.
    """
    lock = lock_run(folder)
    if lock is None:
        return 0
    try:
        try:
            run = _load_run(folder)
            if not try_to_claim(folder):
                return 0
            result = _print(run)
        except Exception as error:
            write_result(folder, _describe_error(error))
            if not isinstance(error, PrinterSlicerError):
                raise
            return error.exit_code
        write_result(folder, result)
    finally:
        lock.release()
    return 0 if result.outcome == "done" else PrintError.exit_code


class _Run(NamedTuple):
    """A run, and what was read for it."""

    folder: Path
    instructions: RunInstructions
    printer: PrinterEntry
    job: Job
    profile: Profile


def _load_run(folder: Path) -> _Run:
    """Read what a run prints, and check its G-code for the printer and the material that is loaded.

    Raises:
        PrinterSlicerError: the file, the profile or the name of a finding is invalid.
        OSError, ValueError: a file of the queue is missing or damaged.
    """
    from printer_slicer.input_files import read_input  # noqa: PLC0415 - slow
    from printer_slicer.inspection.lint.scan import lint_text  # noqa: PLC0415 - slow
    from printer_slicer.profile import load_profile  # noqa: PLC0415 - slow

    instructions = read_instructions(folder)
    printer = PrinterEntry(**instructions.printer | {"groups": tuple(instructions.printer["groups"])})
    profile = load_profile(printer.profile, instructions.material, slices=False)
    path = Path(instructions.file)
    text = read_input(path, path.stat().st_size + 1)
    is_streamed = printer.server is None
    job = lint_text(instructions.name, text, profile, streamed=is_streamed).allowing(instructions.allow)
    return _Run(folder, instructions, printer, job, profile)


def _print(run: _Run) -> RunResult:
    """Print a job, and return how the print ended.

    Raises:
        PrinterSlicerError: as `print_job`.
    """
    if run.printer.server is not None:
        return _print_on_server(run)
    with _simulate_printer(run) if run.printer.is_simulated else nullcontext(run.printer.port) as port:
        done = _print_on_port(run, port)
    if done.verified is False:
        return RunResult(
            "failed", "the printer accepted all commands, but is not at the end position of the job"
        )
    return RunResult("done")


def _print_on_port(run: _Run, port: str) -> PrintResult:
    """Print a job on a port. An unfinished print of this port is deleted: somebody has declared the bed clear."""
    from printer_slicer.inspection.lint.typed_commands import make_command_check  # noqa: PLC0415 - slow
    from printer_slicer.printing import print_job  # noqa: PLC0415 - slow
    from printer_slicer.printing.detached import write_ready_file  # noqa: PLC0415 - slow

    return print_job(
        run.job,
        run.profile,
        port,
        baud=run.printer.baud or None,
        job_store=Path(run.instructions.job_store),
        folder_name=run.folder.name,
        discard=True,
        reconnect=run.printer.reconnect,
        guard=run.printer.guard,
        allow=make_command_check(run.profile, run.job.allowed),
        on_ready=partial(write_ready_file, run.folder / READY_FILE),
    )


def _print_on_server(run: _Run) -> RunResult:
    """Print a job on a print server."""
    from printer_slicer.diagnostics import raise_on_errors  # noqa: PLC0415 - for print servers only
    from printer_slicer.print_queue.remote_print import RemotePrinter, print_remotely  # noqa: PLC0415 - slow
    from printer_slicer.printing.detached import write_ready_file  # noqa: PLC0415 - slow

    raise_on_errors(run.job.findings, run.job.allowed, name=run.job.name)
    return print_remotely(
        RemotePrinter(run.printer),
        Path(run.instructions.file),
        f"{run.folder.name}.gcode",
        is_cancelled=lambda: is_end_requested(run.folder),
        on_start=lambda: write_ready_file(run.folder / READY_FILE, run.folder),
    )


@contextmanager
def _simulate_printer(run: _Run) -> Iterator[str]:
    """Yield the port of a simulated printer, which exists within the `with` block only.

    Afterwards, the file simulation.json tells which commands it has executed.
    """
    from printer_slicer.inspection.dry_run.comparison import Comparison  # noqa: PLC0415 - for simulated printers only

    executed = Comparison(run.job.commands)
    stop, ready, failures = Flag(), Flag(), list[BaseException]()

    def serve_printer() -> None:
        """Serve the simulated printer until the print has ended."""
        try:
            _serve_simulated_printer(run, executed, stop, ready)
        except BaseException as error:  # noqa: BLE001 - raised again in the other thread
            failures.append(error)
            ready.set()

    thread = Thread(target=serve_printer, name="simulated printer", daemon=True)
    thread.start()
    ready.wait()
    if failures:
        raise failures[0]
    try:
        yield str(run.folder / _PORT_LINK)
    finally:
        stop.set()
        thread.join()
        facts = {
            "executed": executed.executed,
            "unexpected": executed.n_unexpected,
            "digest": executed.digest,
        }
        save(run.folder / _SIMULATION_FILE, json.dumps(facts).encode())


def _serve_simulated_printer(run: _Run, executed: Comparison, stop: Flag, ready: Flag) -> None:
    """Serve a simulated printer at a link in the folder of the run until `stop` is set."""
    from printer_slicer.inspection.dry_run.machines import (  # noqa: PLC0415 - for simulated printers only
        machine_of,
        simulated_firmware_for,
    )
    from printer_slicer.sim.link import Cable  # noqa: PLC0415 - for simulated printers only
    from printer_slicer.sim.printer import SimulatedPrinter  # noqa: PLC0415 - for simulated printers only
    from printer_slicer.sim.pty_server import serve  # noqa: PLC0415 - for simulated printers only

    printer = run.profile.printer
    machine, firmware = machine_of(printer), simulated_firmware_for(printer)
    baud = run.printer.baud or (None if firmware.receive_buffer is None else printer.baud)
    serve(
        lambda: SimulatedPrinter(machine, firmware, on_executed=executed),
        run.folder / _PORT_LINK,
        speed=run.printer.speed,
        connect=partial(Cable, baud=baud),
        stop=stop.is_set,
        ready=lambda _: ready.set(),
    )


def _describe_error(error: Exception) -> RunResult:
    """Return how a run ended that raised an error."""
    message = (
        str(error.args[0] if error.args else error) if isinstance(error, PrinterSlicerError) else repr(error)
    )
    if isinstance(error, Cancelled):
        return RunResult("cancelled", message)
    if isinstance(error, PortError):  # raised only before the first byte; later ones are a `PrintError`
        return RunResult("not_started", message)
    if isinstance(error, PrintError) or not isinstance(error, PrinterSlicerError):
        return RunResult("failed", message)
    findings = error.names if isinstance(error, PolicyError) else ()
    return RunResult("rejected", f"{message}; nothing was sent", findings)


if __name__ == "__main__":
    _raise_priority()
    sys.exit(main(sys.argv[1:]))
