"""The command line: `printer-slicer`. Each command imports what it needs when it is called."""

from __future__ import annotations

import argparse
import contextlib
import gc
import os
import sys
import warnings
from collections.abc import Sequence

from printer_slicer.cli.inputs import inputs
from printer_slicer.cli.output import coloured, outlive_readers, unwritten, visible
from printer_slicer.cli.parser import COMMANDS, build_parser
from printer_slicer.errors import PrinterSlicerError

__all__ = ["main"]

# No command multiplies large matrices; starting a thread per core for it would cost more CPU than slicing a small part.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_OBJECTS = 100_000  # made before the collector looks for cycles of garbage; at the usual 700 it looks a hundred times


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code: 0 done, 2 usage, 3 the part cannot be sliced, 4 the port, 5 print failed, 6 cancelled,
        7 verification failed. It does not depend on whether anyone reads stdout and stderr to the end.
    """
    gc.set_threshold(_OBJECTS)  # values are frozen and hold arrays, in no cycles
    outlive_readers()
    warnings.showwarning = _show_warning  # type: ignore[assignment]
    asks = "_ARGCOMPLETE" in os.environ  # a shell asks what could be typed
    words = os.environ.get("COMP_LINE", "").split() if asks else sys.argv[1:] if argv is None else argv
    parser = build_parser([word for word in words if word in COMMANDS][:1])
    if asks:
        from printer_slicer.cli.completing import complete

        complete(parser)
    code = 0
    try:
        try:
            code = _run(parser, argv)
        finally:  # also where --help ends it
            sys.stdout.flush()
            if missed := unwritten():
                raise missed
    except OSError as error:
        failed = _output_failed(error)
        code = code or failed
    return code


def _run(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Run the command; failures become messages and exit codes."""
    folder = ""
    try:
        arguments = parser.parse_args(argv)
        with inputs(arguments) as folder:
            return int(arguments.run(arguments))
    except PrinterSlicerError as error:
        return _fail(str(error).replace(f"{folder}{os.sep}", "") if folder else str(error), error.exit_code)
    except KeyboardInterrupt:
        return _fail("cancelled", 6)
    except OSError:
        raise
    except MemoryError:
        return _fail("not enough memory\n  close other programs, or use a mesh of fewer facets", 1)
    except Exception as error:  # people get a message, never a traceback
        if os.environ.get("PRINTER_SLICER_TRACEBACK"):
            raise
        return _fail(
            f"internal error: {type(error).__name__}: {error}\n"
            "  this is a fault of printer-slicer: please report it;"
            " PRINTER_SLICER_TRACEBACK=1 shows where it happened",
            1,
        )


def _output_failed(error: OSError) -> int:
    """Stdout cannot be written, because its disk is full."""
    # Point stdout at nothing, so that closing it at the end of the process cannot fail again.
    with contextlib.suppress(OSError):  # a stdout that is no file has nothing to close
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _fail(
        f"the output is not all there: {error.strerror or error}\n  check free space and permissions", 2
    )


def _show_warning(message: Warning | str, *_: object) -> None:
    """Print a warning of Python's as one of this program."""
    with contextlib.suppress(OSError):  # nobody is left to be told
        print(visible(f"printer-slicer: warning: {message}"), file=sys.stderr)


def _fail(message: str, code: int) -> int:
    with contextlib.suppress(OSError):  # nobody is left to be told
        print(f"{coloured('printer-slicer:', 'error', sys.stderr)} {visible(message)}", file=sys.stderr)
    return code
