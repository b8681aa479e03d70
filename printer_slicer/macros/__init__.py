"""PrusaSlicer's placeholder language, in which G-code macros are written: macros read settings but cannot run code."""

from printer_slicer.macros.evaluation import evaluate, is_true
from printer_slicer.macros.names import add_names_of_other_slicers, get_placeholder_names
from printer_slicer.macros.syntax import parse_expression
from printer_slicer.macros.templates import Template, escape_braces, read_template
from printer_slicer.macros.values import Items, MacroFault, UnknownName, Value, format_literal, format_value

__all__ = [
    "Items",
    "MacroFault",
    "Template",
    "UnknownName",
    "Value",
    "add_names_of_other_slicers",
    "escape_braces",
    "evaluate",
    "format_literal",
    "format_value",
    "get_placeholder_names",
    "is_true",
    "parse_expression",
    "read_template",
]
