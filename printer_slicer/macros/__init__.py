"""The template language of G-code macros: text with `{expressions}` and `{if}` blocks; reads settings, runs no code."""

from printer_slicer.macros.templates import Template, read_template
from printer_slicer.macros.values import Value, number, text_of

__all__ = ["Template", "Value", "number", "read_template", "text_of"]
