"""The command line `printer-slicer`; each command imports the modules that it needs when it is called."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Sequence

from printer_slicer.cli.inputs import resolve_inputs
from printer_slicer.cli.output import colourize, get_lost_output_error, sanitize, survive_closed_streams
from printer_slicer.cli.parser import COMMANDS, build_parser
from printer_slicer.errors import PrinterSlicerError

__all__ = ["main"]

# No command multiplies large matrices, and starting a thread per core costs more CPU time than slicing a small part.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_GC_THRESHOLD = 100_000  # allocations between garbage collections; the default is 700


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command of the command line, and return its exit code.

    Args:
        argv: arguments without the program's name; None: the arguments of the process.

    Returns:
        The exit code: 0 done, 2 usage, 3 the part cannot be sliced, 4 serial port, 5 print failed, 6 cancelled,
        7 verification failed. A reader that closes stdout or stderr early does not change it.
    """
    gc.set_threshold(_GC_THRESHOLD)  # our values form no reference cycles
    _skip_last_collection()
    survive_closed_streams()
    warnings.showwarning = _show_warning  # type: ignore[assignment]
    is_completion_request = "_ARGCOMPLETE" in os.environ  # the shell requests completions
    words = (
        os.environ.get("COMP_LINE", "").split()
        if is_completion_request
        else sys.argv[1:]
        if argv is None
        else argv
    )
    parser = build_parser([word for word in words if word in COMMANDS][:1], with_others=is_completion_request)
    if is_completion_request:
        from printer_slicer.cli.shell_completion import answer_completion_request

        answer_completion_request(parser)
    code = 0
    try:
        try:
            code = _run_command(parser, argv)
        finally:  # also after --help
            sys.stdout.flush()
            if lost := get_lost_output_error():
                raise lost
    except OSError as error:
        failed = _report_output_error(error)
        code = code or failed
    return code


def _skip_last_collection() -> None:
    """Let the interpreter not search all objects for reference cycles when it exits, which takes as long as a stage."""
    atexit.unregister(gc.freeze)  # `main` may be called several times
    atexit.register(gc.freeze)


def _run_command(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Run the command; print an error as a message, and return the exit code."""
    folder = ""
    try:
        arguments = parser.parse_args(argv)
        arguments.command_line = list(sys.argv[1:] if argv is None else argv)
        with resolve_inputs(arguments) as folder:
            return int(arguments.run(arguments))
    except PrinterSlicerError as error:
        from printer_slicer.cli.argument_flags import replace_arguments_by_options

        message = replace_arguments_by_options(str(error))
        return _print_error(message.replace(f"{folder}{os.sep}", "") if folder else message, error.exit_code)
    except KeyboardInterrupt:
        return _print_error("cancelled", 6)
    except OSError:
        raise
    except MemoryError:
        return _print_error("not enough memory\n  Close other programs, or use a mesh with fewer facets", 1)
    except Exception as error:  # users get a message, never a traceback
        if os.environ.get("PRINTER_SLICER_TRACEBACK"):
            raise
        return _print_error(
            f"internal error: {type(error).__name__}: {error}\n"
            "  This is a bug: please report it, with the traceback that PRINTER_SLICER_TRACEBACK=1 prints",
            1,
        )


def _report_output_error(error: OSError) -> int:
    """Print an error message that stdout could not be written; return the exit code."""
    # Redirect stdout to the null device, so that closing it at exit cannot fail again.
    with contextlib.suppress(OSError):  # stdout may have no file descriptor
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _print_error(
        f"the output is incomplete: {error.strerror or error}\n  Check the free space and the permissions", 2
    )


def _show_warning(message: Warning | str, *_: object) -> None:
    """Print a Python warning like a warning of this program."""
    with contextlib.suppress(OSError):  # stderr may be closed
        print(sanitize(f"printer-slicer: warning: {message}"), file=sys.stderr)


def _print_error(message: str, code: int) -> int:
    """Print an error message, and return the exit code."""
    with contextlib.suppress(OSError):  # stderr may be closed
        print(f"{colourize('printer-slicer:', 'error', sys.stderr)} {sanitize(message)}", file=sys.stderr)
    return code
