"""Find what would go wrong with a print before it is printed.

- `deposition`: where a print puts plastic, and where nothing is under it; fed by the moves of any source.
- `lint`: rules on the commands of a file.
- `coverage`: the material of a file against its model.
- `dry_run`: the file on a simulated printer, and the timing of the link.

Everything found is a `printer_slicer.diagnostics` value. Importing a package of this room costs nothing: import what
you need from its modules.
"""
