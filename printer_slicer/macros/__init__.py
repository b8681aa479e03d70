"""The language of G-code macros, PrusaSlicer's placeholder language: reads settings, runs no code."""

from printer_slicer.macros.evaluation import evaluate, is_true
from printer_slicer.macros.names import known_names, with_other_names
from printer_slicer.macros.syntax import parse_expression
from printer_slicer.macros.templates import Template, escaped, read_template
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, literal, text_of

__all__ = [
    "Items",
    "MacroFault",
    "Template",
    "UnknownName",
    "Value",
    "escaped",
    "evaluate",
    "is_true",
    "known_names",
    "literal",
    "parse_expression",
    "read_template",
    "text_of",
    "with_other_names",
]
