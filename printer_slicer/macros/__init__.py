"""The language of G-code macros, PrusaSlicer's placeholder language: it reads settings and runs no code."""

from printer_slicer.macros.evaluation import evaluate, is_true
from printer_slicer.macros.names import add_other_names, known_names
from printer_slicer.macros.syntax import parse_expression
from printer_slicer.macros.templates import Template, escape_braces, read_template
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, format_value, literal

__all__ = [
    "Items",
    "MacroFault",
    "Template",
    "UnknownName",
    "Value",
    "add_other_names",
    "escape_braces",
    "evaluate",
    "format_value",
    "is_true",
    "known_names",
    "literal",
    "parse_expression",
    "read_template",
]
