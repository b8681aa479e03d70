"""Which errors no test provokes: every place where one of our errors is made, against those that the tests reach.

    python benchmarks/raises.py [arguments of pytest]

Errors tell where they are made; nothing is traced, so the tests take as long as they do anyway. Tests that start
processes of their own count too.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from textwrap import indent
from typing import Any

import pytest

from printer_slicer import errors

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "printer_slicer"
KINDS = {name for name in errors.__all__ if issubclass(getattr(errors, name), errors.PrinterSlicerError)}
_HOOK = """\
import sys, printer_slicer.errors as errors
made = errors.PrinterSlicerError.__init__
def __init__(self, *given, **named):
    frame = sys._getframe(1)
    while frame.f_code.co_name == "__init__" and frame.f_code.co_filename.endswith("errors.py"):
        frame = frame.f_back
    with open({told!r}, "a") as file:
        file.write(f"{{frame.f_code.co_filename}}:{{frame.f_lineno}}\\n")
    made(self, *given, **named)
errors.PrinterSlicerError.__init__ = __init__
"""


def sites() -> dict[tuple[str, int], str]:
    """Every place where an error is made: file and line -> kind and the beginning of what it says."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if name in KINDS and isinstance(node, ast.Call):
                said = ast.unparse(node.args[0]) if node.args else ""
                found[str(path), node.lineno] = f"{name}({said[:90]}"
    return found


class _Hooked(subprocess.Popen):
    """Processes that tests start, whatever environment they give them."""

    folder = ""

    def __init__(self, *given: Any, env: Mapping[str, str] | None = None, **named: Any) -> None:
        known = dict(os.environ if env is None else env)
        paths = [self.folder, *filter(None, [known.get("PYTHONPATH")])]
        super().__init__(*given, env=known | {"PYTHONPATH": os.pathsep.join(paths)}, **named)


def main(arguments: list[str]) -> int:
    """Run the tests and print what they left out; the exit code says whether they left out anything."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "told.txt"
        told.touch()
        hook = _HOOK.format(told=str(told))
        # For this process, and for those that tests start.
        anywhere = "from contextlib import suppress\nwith suppress(ImportError):\n" + indent(hook, "    ")
        (Path(folder) / "sitecustomize.py").write_text(anywhere)
        _Hooked.folder = folder
        subprocess.Popen = _Hooked  # type: ignore[misc]
        exec(hook, {})
        code = pytest.main(arguments)
        reached = set(told.read_text().split("\n"))
    known = sites()
    missing = {place: said for place, said in known.items() if f"{place[0]}:{place[1]}" not in reached}
    for (path, line), said in missing.items():
        print(f"{Path(path).relative_to(ROOT)}:{line}: {said}")
    print(f"{len(known) - len(missing)} of {len(known)} errors were provoked")
    return int(code) or int(bool(missing))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
