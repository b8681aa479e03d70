"""`batch`: slice many models with many settings, in several processes or on a cluster."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import (
    STRICT_HELP,
    add_keep_up_option,
    add_output_options,
    add_setting_options,
    add_transform_options,
    add_units_option,
    parse_copies,
    parse_positive_integer,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.matrix import add_matrix_option, load_combinations
from printer_slicer.cli.opening import add_open_option, open_files
from printer_slicer.cli.output import Milestones, print_text, sanitize, show_stages, write_file
from printer_slicer.cli.settings import collect_profile_facts
from printer_slicer.errors import UsageError
from printer_slicer.saving import check_writable
from printer_slicer.texts import format_duration, format_significant

if TYPE_CHECKING:
    from printer_slicer.batching.tasks import BatchResult, BatchTask, Combination

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer batch *.stl --output-dir gcode
  printer-slicer batch *.stl --output-dir gcode --report report.html --open
  printer-slicer batch part.stl --output-dir sweep --matrix quality=draft,fine --matrix tolerance=0.02,0.05
  printer-slicer batch *.3mf --output-dir gcode --resume              slice what is missing
  printer-slicer batch *.stl --output-dir gcode --cluster tcp://10.0.0.5:8786"""
_FAILED: Final = 3
_MAX_SHOWN: Final = 40  # rows
_MIN_SIZE: Final = 200_000  # bytes; the smallest model takes as long as this size of a large one
_MAX_WIDTH: Final = 60  # letters of a name; longer ones shift the columns of their row
_REPORTS: Final = (".csv", ".html")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `batch`."""
    parser.add_argument("models", metavar="MODEL", type=Path, nargs="+", help="models (STL, 3MF, STEP, ...)")
    parser.add_argument(
        "--output-dir",
        metavar="DIR",
        type=Path,
        required=True,
        help="folder for the G-code and the manifest",
    )
    group = parser.add_argument_group("tasks")
    add_matrix_option(group, "slice")
    group.add_argument(
        "--resume", action="store_true", help="keep what the manifest in DIR has, slice the rest"
    )
    where = group.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs",
        metavar="N",
        type=parse_positive_integer,
        help="slice in N processes; default: one per processor",
    )
    where.add_argument(
        "--cluster", metavar="ADDRESS", help="slice on a Dask cluster, such as tcp://10.0.0.5:8786"
    )
    for flag, metavar, usual, text in (
        ("--max-minutes", "N", 60, "stop a task after N minutes; default: 60"),
        ("--max-memory", "GB", 8, "memory of each process; default: 8 GB"),
    ):
        mark_advanced(
            group.add_argument(flag, metavar=metavar, type=parse_positive_integer, default=usual, help=text)
        )
    add_setting_options(parser, strict_help=STRICT_HELP)
    _add_model_options(parser.add_argument_group("models"))
    group = parser.add_argument_group("output")
    group.add_argument(
        "--report",
        metavar="FILE",
        type=Path,
        action="append",
        default=[],
        help="write a table (.csv) or a page (.html)",
    )
    add_output_options(parser, group)
    add_open_option(group)


def _add_model_options(group: argparse._ArgumentGroup) -> None:
    """Add the options for units, size and orientation of the models."""
    group.add_argument(
        "--orient",
        choices=("off", "fast", "careful"),
        default="off",
        metavar="HOW",
        help="turn each part to print well: off, fast or careful",
    )
    mark_advanced(add_keep_up_option(group, "--orient-keep-up"))
    for action in add_transform_options(group):
        mark_advanced(action)
    mark_advanced(
        group.add_argument(
            "--copies", metavar="N", type=parse_copies, default=1, help="print N copies of each model"
        )
    )
    mark_advanced(add_units_option(group))


def run(arguments: argparse.Namespace) -> int:
    """Slice all models with all combinations of settings."""
    from printer_slicer.batching.executors import count_processors, open_workers
    from printer_slicer.batching.running import run_batch
    from printer_slicer.process_limits import ProcessLimits
    from printer_slicer.saving import make_folder

    _check_options(arguments)
    combinations = load_combinations(arguments)
    tasks = _list_tasks(arguments, combinations)
    folder: Path = arguments.output_dir
    make_folder(folder)
    limits = ProcessLimits(60.0 * arguments.max_minutes, arguments.max_memory << 30)
    n_processes = min(arguments.jobs or count_processors(), len(tasks))
    try:
        with show_stages(arguments) as report:
            progress = _Progress(arguments, tasks, report)
            with open_workers(n_processes, arguments.cluster or "", limits) as workers:
                results = run_batch(tasks, workers, folder, resumes=arguments.resume, tell=progress.add)
    except KeyboardInterrupt:
        done = f"{progress.n_done} of {len(tasks)} are in {folder}; continue with --resume"
        print(sanitize(f"printer-slicer: {done}"), file=sys.stderr)
        raise
    _write_reports(arguments, results)
    _print_results(arguments, results)
    return _FAILED if any(one.problem for one in results) else 0


def _check_options(arguments: argparse.Namespace) -> None:
    """Check options before anything is read.

    Raises:
        UsageError: a report has another suffix, a model is named twice, or an option has no effect.
        OutputError: a report cannot be written.
    """
    for path in arguments.report:
        if path.suffix.lower() not in _REPORTS:
            raise UsageError(
                f"--report {path}: the name must end in .csv or .html", remedy=f"Name it {path.stem}.html"
            )
        check_writable(path)
    for path, count in Counter(arguments.models).items():
        if count > 1:
            raise UsageError(
                f"{path}: is named {count} times", remedy="Name each model once; for copies, use --copies N"
            )
    if arguments.orient_keep_up is not None and arguments.orient == "off":
        raise UsageError("--orient-keep-up: has no effect without --orient", remedy="Add --orient fast")


def _list_tasks(arguments: argparse.Namespace, combinations: Sequence[Combination]) -> list[BatchTask]:
    """Return a task for each model and combination of settings.

    Raises:
        UsageError: a model cannot be read.
    """
    from printer_slicer.batching.tasks import ModelOptions, list_tasks

    options = ModelOptions(
        units=arguments.units,
        scale=tuple(arguments.scale[:3]) if arguments.scale else (1.0, 1.0, 1.0),
        rotate=tuple(arguments.rotate or (0.0, 0.0, 0.0)),
        orient=arguments.orient,
        keep_up=180.0 if arguments.orient_keep_up is None else arguments.orient_keep_up,
        copies=arguments.copies,
    )
    has_picture = any(path.suffix.lower() == ".html" for path in arguments.report)
    return list_tasks(
        arguments.models,
        combinations,
        options,
        strict=arguments.strict,
        has_picture=has_picture,
        max_seconds=60.0 * arguments.max_minutes,
    )


class _Progress:
    """Counts results, and reports how many are done and how long the rest takes."""

    def __init__(
        self, arguments: argparse.Namespace, tasks: Sequence[BatchTask], report: Callable[[str], object]
    ) -> None:
        is_quiet = arguments.quiet or arguments.json
        self._sizes = {task.name: task.model.size + _MIN_SIZE for task in tasks}
        self._report, self._is_verbose = report, arguments.verbose
        self._lines = Milestones("slicing", wanted=not (is_quiet or arguments.verbose or sys.stderr.isatty()))
        self._began, self._done_size, self._kept_size = monotonic(), 0, 0
        self._n_failed = 0
        self.n_done = 0

    def add(self, result: BatchResult, *, is_kept: bool) -> None:
        """Count a result; those that are kept from an earlier run take no time."""
        self.n_done += 1
        self._n_failed += bool(result.problem)
        self._kept_size += self._sizes[result.task] * is_kept
        self._done_size += self._sizes[result.task] * (not is_kept)
        name = f"{result.task}: {result.problem or 'done'}" if self._is_verbose else ""
        self._report(name or self._describe())
        self._lines.report_if_due(self.n_done, len(self._sizes), self._describe)

    def _describe(self) -> str:
        """Return how many tasks are done, and how long the rest takes if time grows with size."""
        rest = sum(self._sizes.values()) - self._done_size - self._kept_size
        seconds = (monotonic() - self._began) * rest / max(self._done_size, 1)
        failed = f", {self._n_failed} failed" if self._n_failed else ""
        left = f", about {format_duration(seconds)} left" if rest and self._done_size else ""
        return f"{self.n_done} of {len(self._sizes)} sliced{failed}{left}"


def _write_reports(arguments: argparse.Namespace, results: Sequence[BatchResult]) -> None:
    """Write the reports."""
    from printer_slicer.batching.pictures import add_pictures
    from printer_slicer.batching.reports import make_csv, make_page

    if any(path.suffix.lower() == ".html" for path in arguments.report):
        results = add_pictures(results, arguments.output_dir)
    for path in arguments.report:
        is_page = path.suffix.lower() == ".html"
        title = f"Batch in {arguments.output_dir.name or arguments.output_dir}"
        write_file(path, make_page(results, title) if is_page else make_csv(results))
    open_files(arguments, [path for path in arguments.report if path.suffix.lower() == ".html"])


def _print_results(arguments: argparse.Namespace, results: Sequence[BatchResult]) -> None:
    """Print a table of the results, and how many tasks failed."""
    from printer_slicer.batching.reports import collect_row, mark_best_rows

    has_choices = bool(arguments.matrix)
    best = mark_best_rows(results) if has_choices else [False] * len(results)
    rows = [
        collect_row(one) | ({"best": mark} if has_choices else {})
        for one, mark in zip(results, best, strict=True)
    ]
    n_failed = sum(bool(one.problem) for one in results)
    if arguments.json:
        facts: dict[str, Any] = {
            "output_dir": str(arguments.output_dir),
            "tasks": rows,
            "failed": n_failed,
        }
        print(json.dumps(facts | collect_profile_facts(arguments)))
        return
    width = min(max(len(one.task) for one in results), _MAX_WIDTH)
    table = list(zip(results, rows, best, strict=True))
    lines = [_format_row(one, row, width, is_best=mark) for one, row, mark in table[:_MAX_SHOWN]]
    if len(table) > _MAX_SHOWN:
        lines.append(f"... and {len(table) - _MAX_SHOWN} more; --report FILE.html lists all")
        lines += [f"{one.task}: failed: {one.problem}" for one in results[_MAX_SHOWN:] if one.problem]
    if has_choices:
        lines.append("*: no other row of this part has less print time, deviation and volume error")
    lines.append(f"{arguments.output_dir}: {len(results) - n_failed} of {len(results)} sliced")
    print_text(arguments, "\n".join(lines))


def _format_row(result: BatchResult, row: dict[str, Any], width: int, *, is_best: bool) -> str:
    """Format a result as a line of the table."""
    start = f"{'*' if is_best else ' '} {' '.join(result.task.split()):<{width}}"
    if result.problem:
        return f"{start}  failed: {result.problem}"
    numbers = (
        f"{format_duration(row['seconds']):>12}{format_significant(row['filament_g']) + ' g':>10}"
        f"{row['layers']:>6} layers{format_significant(row['max_error_mm']) + ' mm':>12}"
        f"{format_significant(row['volume_error_mm3']) + ' mm³':>12}"
    )
    warnings = (
        f"  {len(result.warnings)} warning{'s' * (len(result.warnings) > 1)}" if result.warnings else ""
    )
    return f"{start}{numbers}{warnings}"
