"""The material of a print against the sections of its model: what is laid where, what is missing, what is twice.

stack = stacked(beads_of_gcode(text).beads)
coverage = ledger_of(stack, sections)      # one section for each layer of the stack
problems = findings(coverage)
"""
