"""Compare the material of a print with the sections of its model: gaps, overlaps, outline, volume.

stack = stacked(beads_of_gcode(text).beads)
coverage = ledger_of(stack, sections)      # one section for each layer of the stack
problems = findings(coverage)
"""
