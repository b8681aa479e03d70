"""Find what would go wrong with a print before it is printed.

- `deposition`: where a print extrudes, and where that extrusion is unsupported; fed by the moves of any source.
- `lint`: rules on the commands of a file.
- `coverage`: the material of a file against its model.
- `dry_run`: the file on a simulated printer, and the timing of the link.

Findings are `printer_slicer.diagnostics` values. The packages have no names of their own: import from their modules.
"""
