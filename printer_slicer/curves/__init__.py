"""Toolpaths -> Toolpaths: the same ways said in fewer words, as arcs or as longer lines."""

from printer_slicer.curves.arcs import curved
from printer_slicer.curves.merging import merged

__all__ = ["curved", "merged"]
