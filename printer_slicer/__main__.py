"""Run the command line with `python -m printer_slicer`."""

import sys

from printer_slicer.cli import main

if __name__ == "__main__":
    sys.exit(main())
