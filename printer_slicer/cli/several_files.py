"""Run a command for each of several G-code files: one line per file, and the worst exit code."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any, Final, NamedTuple

from printer_slicer.cli.output import print_text, sanitize, show_stages
from printer_slicer.errors import PrinterSlicerError

__all__ = ["FilesAction", "run_for_each_file"]

_WORST: Final = (2, 1, 4, 3, 5, 7)
"""Exit codes from the least to the most important one; 0 comes before all."""


class FilesAction(argparse.Action):
    """Action of a positional argument: the first file is `gcode`, the others are `more_files`."""

    def __call__(
        self, _parser: object, namespace: argparse.Namespace, value: Any, _flag: object = None
    ) -> None:
        """Store the files."""
        namespace.gcode, *namespace.more_files = value


class _FileResult(NamedTuple):
    """What a command found in one file."""

    path: Path
    code: int
    facts: dict[str, Any]
    problem: str


def run_for_each_file(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    run: Callable[[Path], int],
    describe: Callable[[dict[str, Any]], str],
) -> int:
    """Run a command for each file, print a line about each, and return the worst exit code.

    Args:
        arguments: the command line.
        paths: the files.
        run: runs the command for a file, and prints JSON.
        describe: returns a few words about the facts of a file.
    """
    results = []
    with show_stages(arguments) as report:
        for done, path in enumerate(paths):
            report(f"{path.name} ({done + 1} of {len(paths)})")
            results.append(_run_for_file(path, run))
    if arguments.json:
        print(json.dumps({"files": [_collect_facts(one) for one in results]}))
    else:
        width = max(len(sanitize(str(one.path))) for one in results)
        lines = [f"{sanitize(str(one.path)):<{width}}  {_describe(one, describe)}" for one in results]
        failed = sum(one.code != 0 for one in results)
        lines.append(f"{len(results) - failed} of {len(results)} files without problems")
        print_text(arguments, "\n".join(lines), is_message=False)
    return max((one.code for one in results), key=lambda code: _WORST.index(code) if code in _WORST else -1)


def _run_for_file(path: Path, run: Callable[[Path], int]) -> _FileResult:
    """Run the command for a file, and parse its JSON output."""
    out, problem = StringIO(), ""
    try:
        with redirect_stdout(out):
            code = run(path)
    except PrinterSlicerError as error:
        code, problem = error.exit_code, " ".join(str(error.args[0]).split())
    text = out.getvalue()
    facts = json.loads(text) if text.strip() else {}
    return _FileResult(path, code, facts, problem.removeprefix(f"{path.name}: ").removeprefix(f"{path}: "))


def _collect_facts(result: _FileResult) -> dict[str, Any]:
    """Return the facts about a file for JSON."""
    own = {"file": str(result.path), "exit_code": result.code, "problem": result.problem}
    return result.facts | own


def _describe(result: _FileResult, describe: Callable[[dict[str, Any]], str]) -> str:
    """Return the line about a file, without its name."""
    known = describe(result.facts) if result.facts else ""
    return ("ok" if not result.code else f"failed: {result.problem}") + (f"; {known}" if known else "")
