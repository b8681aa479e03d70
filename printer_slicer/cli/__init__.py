"""The command line: `printer-slicer`. Each command imports what it needs when it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from printer_slicer.cli.parser import build_parser
from printer_slicer.errors import PrinterSlicerError

__all__ = ["main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: arguments without the program's name; None takes those of the process.

    Returns:
        The exit code: 0 done, 2 usage, 3 the part cannot be sliced, 4 the port, 5 print failed, 6 cancelled,
        7 verification failed.
    """
    arguments = build_parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except PrinterSlicerError as error:
        return _fail(str(error), error.exit_code)
    except KeyboardInterrupt:
        return _fail("cancelled", 6)
    except BrokenPipeError:
        # The reader of our output has gone (`| head`); point stdout at nothing so that closing it cannot fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:  # people get a message, never a traceback
        if os.environ.get("PRINTER_SLICER_TRACEBACK"):
            raise
        return _fail(
            f"internal error: {type(error).__name__}: {error}\n"
            "  this is a fault of printer-slicer: please report it; PRINTER_SLICER_TRACEBACK=1 shows where it happened",
            1,
        )


def _fail(message: str, code: int) -> int:
    print(f"printer-slicer: {message}", file=sys.stderr)
    return code
