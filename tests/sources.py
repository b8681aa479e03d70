"""The syntax trees of the package, parsed once per process for all tests that read them."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path

__all__ = ["PACKAGE", "SOURCES", "trees"]

PACKAGE = Path(__file__).parents[1] / "printer_slicer"
SOURCES = sorted(PACKAGE.rglob("*.py"))


@cache
def trees() -> Mapping[Path, ast.Module]:
    """The tree of every module, by its file."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in SOURCES}
