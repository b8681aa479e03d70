"""Print a job on the simulated printer under an invented clock, and judge what came out."""

from printer_slicer.verdict.comparison import Comparison
from printer_slicer.verdict.faults import Fault, sentence
from printer_slicer.verdict.judging import Verdict, judge
from printer_slicer.verdict.machines import front_end_of, machine_of
from printer_slicer.verdict.rehearsal import dry_run, layer_counter

__all__ = [
    "Comparison",
    "Fault",
    "Verdict",
    "dry_run",
    "front_end_of",
    "judge",
    "layer_counter",
    "machine_of",
    "sentence",
]
