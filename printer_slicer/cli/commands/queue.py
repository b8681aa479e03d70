"""`queue`: queue G-code files for one or several printers, and print them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    add_allow_option,
    add_output_options,
    add_printers_file_option,
    parse_positive_integer,
)
from printer_slicer.cli.connection_options import read_server_key
from printer_slicer.cli.help import format_actions, mark_advanced
from printer_slicer.cli.output import print_result, print_text
from printer_slicer.errors import UsageError
from printer_slicer.input_files import read_pieces
from printer_slicer.texts import format_duration
from printer_slicer.values import as_dict

if TYPE_CHECKING:
    from printer_slicer.print_queue import PrinterState, PrintQueue, QueuedFile, QueuedJob

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer queue add part.gcode --copies 3
  printer-slicer queue clear-bed left
  printer-slicer queue run
  printer-slicer queue explain 2
  printer-slicer queue move 3 first             also: move 3 last, move 3 before 2"""
_ACTIONS: Final = {
    "list": "list printers and jobs, with --all also jobs that have ended",
    "add": "FILE...: add a job for each G-code file",
    "move": "JOB first | last | before JOB: change the order",
    "explain": "JOB: say why a job waits",
    "hold": "JOB...: do not start the job until it is released",
    "release": "JOB...: start a held, failed or cancelled job when its turn comes",
    "cancel": "JOB...: remove the job from the queue, or end its print",
    "clear-bed": "PRINTER...: you have taken the part off the bed",
    "occupy-bed": "PRINTER...: there is a part on the bed",
    "load": "PRINTER MATERIAL: record which material is loaded",
    "add-printer": "NAME PORT PROFILE: add a printer to printers.toml",
    "run": "start jobs on printers with a clear bed, until Ctrl-C",
}
_BEDS: Final = {"clear": "bed clear", "occupied": "bed occupied", "unknown": "bed may be occupied"}
_MAX_ENDED: Final = 100  # jobs that --all lists


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `queue`."""
    parser.epilog = format_actions(_ACTIONS)
    parser.add_argument(
        "what",
        nargs="?",
        metavar="ACTION",
        choices=tuple(_ACTIONS),
        default="list",
        help="one of the actions below; default: list",
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="files, numbers of jobs, or names of printers"
    )
    parser.add_argument(
        "--printer", metavar="NAME", default="", help="for add: a printer or a group of printers"
    )
    parser.add_argument(
        "--material",
        metavar="NAME",
        default="",
        help="for add and add-printer; default: that of the file, or pla",
    )
    parser.add_argument(
        "--copies", metavar="N", type=parse_positive_integer, default=1, help="for add: number of jobs"
    )
    parser.add_argument("--held", action="store_true", help="for add: hold the jobs until they are released")
    parser.add_argument("--first", action="store_true", help="for add: place the jobs before all others")
    mark_advanced(
        parser.add_argument(
            "--no-check", action="store_true", help="for add-printer: do not compare firmware and profile"
        )
    )
    parser.add_argument("--all", action="store_true", help="for list: also jobs that have ended")
    parser.add_argument(
        "--server",
        metavar="URL",
        default="",
        help="use the queue of the printer-slicer server at this address",
    )
    parser.add_argument(
        "--key-file", metavar="FILE", type=Path, help="for --server: file with the key of the server"
    )
    add_printers_file_option(parser)
    add_allow_option(parser)
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run an action on the queue, such as list or add."""
    _check_names(arguments)
    queue = _open_queue(arguments)
    try:
        return _ACTION_FUNCTIONS[arguments.what](arguments, queue)
    finally:
        queue.close()


def _open_queue(arguments: argparse.Namespace) -> Any:
    """Return the queue of this computer, or that of a server.

    Raises:
        UsageError: an option or action is for the other one.
    """
    if not arguments.server:
        from printer_slicer.print_queue import open_queue

        if arguments.key_file is not None:
            raise UsageError("--key-file is for --server", remedy="Add --server URL, or remove --key-file")
        return open_queue(printers_file=arguments.printers_file)
    if arguments.what in {"run", "add-printer"} or arguments.printers_file is not None:
        raise UsageError(
            "--server does not work with run, add-printer and --printers-file: the server has its own",
            remedy="Run the command on the computer of the server, without --server",
        )
    from printer_slicer.server.queue_client import QueueClient

    return QueueClient(arguments.server, read_server_key(arguments.key_file))


def _check_names(arguments: argparse.Namespace) -> None:
    """Check the number of names of an action.

    Raises:
        UsageError: there are too few or too many.
    """
    what, count = arguments.what, len(arguments.names)
    needed = {"list": (0, 0), "run": (0, 0), "explain": (1, 1), "load": (2, 2), "move": (2, 3)}
    needed["add-printer"] = (3, 3)
    least, most = needed.get(what, (1, count))
    if not least <= count <= most:
        words = _ACTIONS[what].partition(":")[0] if least else ""
        raise UsageError(
            f"queue {what}: wrong number of arguments ({count})",
            remedy=f"Use printer-slicer queue {what} {words}".rstrip(),
        )


def _parse_job(text: str) -> int:
    """Return the number of a job.

    Raises:
        UsageError: the text is no number.
    """
    number = text.removeprefix("#")
    if not (number.isascii() and number.isdigit() and len(number) < 19):
        raise UsageError(
            f"{text} is not the number of a job", remedy="Run printer-slicer queue list to see the numbers"
        )
    return int(number)


# Jobs.


def _add(arguments: argparse.Namespace, queue: PrintQueue) -> int:
    """Add jobs for G-code files."""
    from printer_slicer.input_files import is_gcode
    from printer_slicer.print_queue import JobRequest

    paths = [Path(name) for name in arguments.names]
    for path in paths:
        if not is_gcode(path):
            raise UsageError(
                f"{path}: the queue takes G-code files", remedy=f"Slice it first: printer-slicer slice {path}"
            )
    queue.list_printers()  # fails before a file is stored
    jobs: list[QueuedJob] = []
    for path in reversed(paths) if arguments.first else paths:
        file = _store_file(arguments, queue, path)
        request = JobRequest(
            name=path.name,
            printer=arguments.printer,
            material=arguments.material,
            allow=tuple(arguments.allow),
            held=arguments.held,
            first=arguments.first,
            copies=arguments.copies,
        )
        jobs += queue.add_jobs(file.id, request)
    lines = [f"job {job.id}: {job.name}{_describe_file(queue, job)}" for job in jobs]
    return print_result(arguments, {"jobs": [as_dict(job) for job in jobs]}, "\n".join(lines))


def _store_file(arguments: argparse.Namespace, queue: Any, path: Path) -> QueuedFile:
    """Store a file in the queue, and what it says about itself."""
    from printer_slicer.print_queue import read_file_facts

    if arguments.server:
        uploaded: QueuedFile = queue.upload(path)
        return uploaded
    file: QueuedFile = queue.add_file(path.name, _read_file(path))
    if queue.read_facts(file.id) is None:
        queue.store_facts(file.id, read_file_facts(queue.files.find_path(file.id), path.name))
    return file


def _read_file(path: Path) -> Iterator[bytes]:
    """Yield a file in pieces.

    Raises:
        UsageError: the file cannot be read.
    """
    try:
        yield from read_pieces(path)
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be read: {error.strerror or error}", remedy="Check the name of the file"
        ) from None


def _describe_file(queue: PrintQueue, job: QueuedJob) -> str:
    """Return the time and the material of a job's file, or why it cannot be printed."""
    facts = queue.read_facts(job.file)
    if facts is None:
        return ""
    material = job.material or facts.material
    described = [facts.problem] if facts.problem else [format_duration(facts.seconds), material]
    return f" ({', '.join(filter(None, described))})"


def _move(arguments: argparse.Namespace, queue: PrintQueue) -> int:
    """Move a job within the queue."""
    from printer_slicer.print_queue.records import WAITING_STATES

    job, where, *other = arguments.names
    number = _parse_job(job)
    if where == "first" and not other:
        waiting = [one.id for one in queue.snapshot().jobs if one.state in WAITING_STATES]
        queue.move_job(number, before=waiting[0] if waiting else None)
    elif where == "last" and not other:
        queue.move_job(number)
    elif where == "before" and other:
        queue.move_job(number, before=_parse_job(other[0]))
    else:
        raise UsageError(
            f"queue move {' '.join(arguments.names)}: unknown place",
            remedy=f"Use printer-slicer queue move {job} first, or last, or before JOB",
        )
    return _list(arguments, queue)


def _change_jobs(
    change: Callable[[PrintQueue, int], object],
) -> Callable[[argparse.Namespace, PrintQueue], int]:
    """Return the action that changes each named job."""

    def act(arguments: argparse.Namespace, queue: PrintQueue) -> int:
        """Change the jobs, and print their states."""
        numbers = [_parse_job(name) for name in arguments.names]
        for number in numbers:
            queue.find_job(number)  # fails before a job is changed
        for number in numbers:
            change(queue, number)
        jobs = [queue.find_job(number) for number in numbers]
        lines = [f"job {job.id}: {_describe_state(job)}" for job in jobs]
        return print_result(arguments, {"jobs": [as_dict(job) for job in jobs]}, "\n".join(lines))

    return act


def _describe_state(job: QueuedJob) -> str:
    """Return the state of a job in words; a message says that its print is being ended."""
    return f"{job.state} ({job.message})" if job.message else job.state


def _cancel(queue: PrintQueue, job: int) -> None:
    """Cancel a job; a print is asked to end at once, or else by the supervisor."""
    from printer_slicer.print_queue import PrintQueue
    from printer_slicer.print_queue.supervisor import request_cancellation

    queue.cancel_job(job)
    if isinstance(queue, PrintQueue):
        request_cancellation(queue, job)


def _explain(arguments: argparse.Namespace, queue: Any) -> int:
    """Explain why a job waits."""
    from printer_slicer.print_queue import explain_job
    from printer_slicer.print_queue.records import WAITING_STATES

    number = _parse_job(arguments.names[0])
    found = queue.explain(number) if arguments.server else explain_job(queue, number)
    lines = [": ".join(filter(None, (found.summary, found.remedy)))]
    if found.job.state in WAITING_STATES:
        reasons = [("; ".join(one.reasons) or "ready to print it", one.remedy) for one in found.printers]
        lines += [
            f"  {one.printer}: {': '.join(filter(None, said))}"
            for one, said in zip(found.printers, reasons, strict=True)
        ]
    return print_result(arguments, as_dict(found), "\n".join(lines))


# Printers.


def _set_beds(bed: Any) -> Callable[[argparse.Namespace, PrintQueue], int]:
    """Return the action that records the state of beds."""

    def act(arguments: argparse.Namespace, queue: PrintQueue) -> int:
        """Record the state of the beds of the named printers."""
        for name in arguments.names:
            queue.set_bed(name, bed)
        return print_result(
            arguments,
            {"printers": arguments.names, "bed": bed},
            "\n".join(f"{name}: {_BEDS[bed]}" for name in arguments.names),
        )

    return act


def _load(arguments: argparse.Namespace, queue: PrintQueue) -> int:
    """Record which material is loaded."""
    printer, material = arguments.names
    queue.set_material(printer, material)
    return print_result(
        arguments, {"printer": printer, "material": material}, f"{printer}: {material} is loaded"
    )


def _add_printer(arguments: argparse.Namespace, _: PrintQueue) -> int:
    """Add a printer to printers.toml."""
    from printer_slicer.print_queue.printer_setup import add_printer
    from printer_slicer.print_queue.printers import PrinterEntry, find_printers_file

    name, port, profile = arguments.names
    path = arguments.printers_file or find_printers_file()
    entry = PrinterEntry(name=name, port=port, profile=profile, material=arguments.material or "pla")
    firmware = add_printer(path, entry, check=not arguments.no_check)
    known = f"; its firmware is {firmware}" if firmware else ""
    facts = {"printer": name, "firmware": firmware, "file": str(path)}
    return print_result(arguments, facts, f"{name}: added to {path}{known}")


# The whole queue.


def _list(arguments: argparse.Namespace, queue: PrintQueue) -> int:
    """List printers and jobs."""
    snapshot = queue.snapshot()
    ended = queue.list_ended_jobs(_MAX_ENDED) if arguments.all else ()
    facts = as_dict(snapshot) | ({"ended": [as_dict(job) for job in ended]} if arguments.all else {})
    lines = [_format_printer(state) for state in snapshot.printers]
    lines += [_format_job(queue, job) for job in (*snapshot.jobs, *ended)]
    return print_result(arguments, facts, "\n".join(lines if snapshot.jobs or ended else [*lines, "no jobs"]))


def _format_printer(state: PrinterState) -> str:
    """Return a line about a printer."""
    doing = f"printing job {state.job}" if state.job is not None else _BEDS[state.bed]
    return f"{state.name}: {doing}, {state.material} is loaded" + (
        f"; {state.message}" if state.message else ""
    )


def _format_job(queue: PrintQueue, job: QueuedJob) -> str:
    """Return a line about a job."""
    wanted = f" for {job.printer}" if job.printer else ""
    return f"job {job.id}: {job.name}{_describe_file(queue, job)}{wanted}, {_describe_state(job)}"


def _run(arguments: argparse.Namespace, queue: PrintQueue) -> int:
    """Start jobs until Ctrl-C or SIGTERM; the prints go on."""
    import signal
    from threading import Event

    from printer_slicer.print_queue.supervisor import Supervisor, lock_queue

    stopped = Event()

    def report(text: str) -> None:
        """Print what has happened, at once."""
        print_result(arguments, {"event": "queue", "text": text}, text)
        print(end="", flush=True)

    names = ", ".join(entry.name for entry in queue.list_printers())
    with lock_queue(queue):
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stopped.set())
        print_text(arguments, f"starting jobs on {names}; Ctrl-C ends this program, but no print")
        print(end="", flush=True)
        Supervisor(queue, on_change=report).run(stopped.is_set)
    return 0


_ACTION_FUNCTIONS: Final[Mapping[str, Callable[[argparse.Namespace, PrintQueue], int]]] = {
    "list": _list,
    "add": _add,
    "move": _move,
    "explain": _explain,
    "hold": _change_jobs(lambda queue, job: queue.hold_job(job)),
    "release": _change_jobs(lambda queue, job: queue.release_job(job)),
    "cancel": _change_jobs(_cancel),
    "clear-bed": _set_beds("clear"),
    "occupy-bed": _set_beds("occupied"),
    "load": _load,
    "add-printer": _add_printer,
    "run": _run,
}
