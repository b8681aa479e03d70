"""Compare the extrusions of a print with the sections of its model: gaps, overlaps, outline, volume.

stack = stack_extrusions(extrusions_of_gcode(text).beads)
coverage = coverage_of(stack, sections)  # one section for each layer of the stack
problems = findings(coverage)
"""
