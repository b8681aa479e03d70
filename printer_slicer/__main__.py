"""`python -m printer_slicer` is `printer-slicer`."""

import sys

from printer_slicer.cli import main

if __name__ == "__main__":
    sys.exit(main())
