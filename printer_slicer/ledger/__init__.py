"""The material ledger: what was laid where, against what should be there.

stack = stacked(beads_of_gcode(text).beads)
ledger = ledger_of(stack, sections)      # one section for each layer of the stack
problems = findings(ledger)
"""

from printer_slicer.ledger.account import Ledger, Rules, ledger_of, overlapping
from printer_slicer.ledger.beads import Beads, Purpose, beads_of, beads_of_moves
from printer_slicer.ledger.limits import Finding, Limits, findings
from printer_slicer.ledger.matching import Match, apart, first_guess, fitted, moved
from printer_slicer.ledger.sheet import Levels, Sheet, levels_of, sheet_of
from printer_slicer.ledger.stack import Stack, stack_of, stacked
from printer_slicer.ledger.text import Deposit, beads_of_gcode

__all__ = [
    "Beads",
    "Deposit",
    "Finding",
    "Ledger",
    "Levels",
    "Limits",
    "Match",
    "Purpose",
    "Rules",
    "Sheet",
    "Stack",
    "apart",
    "beads_of",
    "beads_of_gcode",
    "beads_of_moves",
    "findings",
    "first_guess",
    "fitted",
    "ledger_of",
    "levels_of",
    "moved",
    "overlapping",
    "sheet_of",
    "stack_of",
    "stacked",
]
