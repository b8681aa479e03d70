"""Find the faults of a print job before it is printed.

- `deposition`: a height map of the print, made from moves of any source, and unsupported extrusion.
- `lint`: rules on the commands of a file.
- `coverage`: comparison of the extrusions of a file with its model.
- `dry_run`: execution of the file on a simulated printer, and the timing of the serial link.

Findings are `printer_slicer.diagnostics` values. These packages export no names: import from their modules.
"""
