"""Run a command of printer-slicer with limits: `python -m printer_slicer.server.limited_command WORDS`."""

from __future__ import annotations

import os
import sys

from printer_slicer.server.workers import limit_process

__all__: list[str] = []

if __name__ == "__main__":
    limit_process()
    os.execv(sys.executable, [sys.executable, "-m", "printer_slicer", *sys.argv[1:]])  # noqa: S606 - no shell
