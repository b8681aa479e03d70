"""Update the command outputs in docs/results.md: `just readme`; a test compares them with the commands.

python -m benchmarks.readme
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Mapping
from contextlib import chdir, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from printer_slicer.cli import main as command_line

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "results.md"
_PLAN: Final = (
    "plan",
    "sample_parts/case_study.stl",
    "--printer",
    "marlin_220_06",
    "--quality",
    "case_study",
)


def _run_command(*arguments: str) -> str:
    """Return what a command prints to stdout."""
    with redirect_stdout(io.StringIO()) as out:
        code = command_line(list(arguments))
    if code:
        raise SystemExit(f"printer-slicer {' '.join(arguments)} ended with {code}")
    return out.getvalue()


def _paper() -> str:
    """Return the table of the plans for the part of the paper."""
    with chdir(ROOT):
        plans = json.loads(_run_command(*_PLAN, "--json"))["plans"]
    rows = ["| plan | layers | saved | time | saved |", "|---|---:|---:|---:|---:|", *map(_format_row, plans)]
    return "\n".join(rows)


def _format_row(plan: Mapping[str, Any]) -> str:
    name, *_ = plan["plan"].split()
    runs = ", ".join(f"{count} x {height:g}" for count, height in plan["heights"])
    minutes = round(plan["seconds"] / 60)
    saved = f"{plan['layers_saved']:.1%}".replace("%", " %"), f"{plan['time_saved']:.1%}".replace("%", " %")
    label = plan["plan"] if name == "uniform" else f"{name}, aligned: {runs} mm"
    return (
        f"| {label} | {plan['layers']} | {saved[0]} | {minutes // 60} h {minutes % 60:02d} min | {saved[1]} |"
    )


def _dry_run() -> str:
    """Return the output of the dry run of the vase, sliced by the command above it on the page."""
    made = re.findall(
        r"^printer-slicer (slice sample_parts/vase\.stl -o vase\.gcode .*)$", _text(), re.MULTILINE
    )
    arguments = next(one for one in reversed(made) if "--time-budget" in one).split()
    arguments[1] = str(ROOT / arguments[1])
    with TemporaryDirectory() as folder, chdir(folder):
        _run_command(*arguments)
        text = _run_command("dry-run", "vase.gcode")
    shown = re.split(r"\n(?i:plastic|executed)", text, maxsplit=1)[0]
    return f"```text\n{shown}\n```"


BLOCKS: Final[Mapping[str, Callable[[], str]]] = {"dry-run": _dry_run, "paper": _paper}
"""Functions that return the text between `<!-- NAME -->` and `<!-- end -->`, by name."""


def _text() -> str:
    return PAGE.read_text(encoding="utf-8")


def written(name: str) -> str:
    """Return the text of a block on the page."""
    return _text().partition(f"<!-- {name} -->\n")[2].partition("<!-- end -->")[0].rstrip("\n")


def main() -> None:
    """Update all blocks."""
    text = _text()
    for name, made in BLOCKS.items():
        before, mark, rest = text.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        if not (mark and end):
            raise SystemExit(f"{PAGE}: no block {name!r}")
        text = f"{before}{mark}{made()}\n{end}{after}"
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
