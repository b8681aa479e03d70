"""Overhangs of a part, and the supports below them."""

from __future__ import annotations

from printer_slicer.supports.overhangs import find_overhangs

__all__ = ["find_overhangs"]
