"""Supports: what hangs, and the structures that carry it."""

from __future__ import annotations

from printer_slicer.supports.overhangs import find_overhangs

__all__ = ["find_overhangs"]
