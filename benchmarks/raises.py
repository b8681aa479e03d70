"""Find errors that no test provokes: compare the places where our errors are raised with those that the tests reach.

    python benchmarks/raises.py [arguments of pytest]

Each error records where it is raised. Nothing is traced, so the tests take no longer than usual. Errors in processes
that tests start count, too.
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
    with open({log!r}, "a") as file:
        file.write(f"{{frame.f_code.co_filename}}:{{frame.f_lineno}}\\n")
    made(self, *given, **named)
errors.PrinterSlicerError.__init__ = __init__
"""


def find_raising_lines() -> dict[tuple[str, int], str]:
    """Return every place where an error is raised: file and line -> class and the start of the message."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if name in KINDS and isinstance(node, ast.Call):
                said = ast.unparse(node.args[0]) if node.args else ""
                found[str(path), node.lineno] = f"{name}({said[:90]}"
    return found


class _Hooked(subprocess.Popen):
    """Environment for processes that tests start, whatever environment they pass."""

    folder = ""

    def __init__(self, *given: Any, env: Mapping[str, str] | None = None, **named: Any) -> None:
        known = dict(os.environ if env is None else env)
        paths = [self.folder, *filter(None, [known.get("PYTHONPATH")])]
        super().__init__(*given, env=known | {"PYTHONPATH": os.pathsep.join(paths)}, **named)  # type: ignore[call-overload]


def main(arguments: list[str]) -> int:
    """Run the tests and print the unreached errors; return 1 if there are any."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "raised.txt"
        log.touch()
        hook = _HOOK.format(log=str(log))
        # For this process, and for processes that tests start.
        anywhere = "from contextlib import suppress\nwith suppress(ImportError):\n" + indent(hook, "    ")
        (Path(folder) / "sitecustomize.py").write_text(anywhere)
        _Hooked.folder = folder
        subprocess.Popen = _Hooked  # type: ignore[assignment, misc]
        exec(hook, {})
        code = pytest.main(arguments)
        reached = set(log.read_text().split("\n"))
    known = find_raising_lines()
    missing = {place: said for place, said in known.items() if f"{place[0]}:{place[1]}" not in reached}
    for (path, line), said in missing.items():
        print(f"{Path(path).relative_to(ROOT)}:{line}: {said}")
    print(f"tests raise {len(known) - len(missing)} of {len(known)} errors")
    return int(code) or int(bool(missing))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
