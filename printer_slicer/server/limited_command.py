"""Run a command of printer-slicer with limits: `python -m printer_slicer.server.limited_command WORDS`."""

from __future__ import annotations

import os
import sys

from printer_slicer.process_limits import limit_process
from printer_slicer.server.workers import LIMITS

__all__: list[str] = []

if __name__ == "__main__":
    limit_process(LIMITS, limits_cpu=True)
    os.execv(sys.executable, [sys.executable, "-m", "printer_slicer", *sys.argv[1:]])  # noqa: S606 - no shell
