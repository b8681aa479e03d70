"""`batch`: slice many models from Python."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from types import NoneType
from typing import Any, Final

from printer_slicer.arguments import PATH, check_argument, check_arguments
from printer_slicer.batching.executors import Workers, count_processors, open_workers, use_executor
from printer_slicer.batching.matrix import combine_choices
from printer_slicer.batching.running import run_batch
from printer_slicer.batching.tasks import BatchResult, BatchTask, Combination, list_tasks
from printer_slicer.errors import UsageError
from printer_slicer.process_limits import ProcessLimits
from printer_slicer.profile import KINDS
from printer_slicer.project_settings import chooses_layer_height
from printer_slicer.saving import make_folder
from printer_slicer.slice_jobs import load_slice_profile

__all__ = ["batch"]

_LIMITS: Final = ProcessLimits()


@check_arguments(executor=(Executor, NoneType), jobs=(int, NoneType), output_dir=(*PATH, NoneType))
def batch(
    parts: Sequence[str | os.PathLike[str]],
    settings: Mapping[str, object] | None = None,
    *,
    executor: Executor | None = None,
    jobs: int | None = None,
    output_dir: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> tuple[BatchResult, ...]:
    """Slice many models, each with all combinations of settings.

        results = ps.batch(["lid.stl", "box.stl"], {"quality": ["draft", "fine"], "perimeters": 3}, output_dir="gcode")
        for one in results:
            print(one.task, one.problem or one.total("seconds"))

    Processes that are started afresh import the main module of the program, so a script calls this under
    `if __name__ == "__main__":`.

    Args:
        parts: model files.
        settings: as the keywords of `ps.slice`; a list has the values that are combined.
        executor: where the tasks run, such as `concurrent.futures.ProcessPoolExecutor` or
            `dask.distributed.Client(...).get_executor()`; None: processes of this package, with limits of time and
            memory. Of these, one that is killed is replaced, and fails only its task.
        jobs: number of these processes; None: one per processor.
        output_dir: folder for the G-code and the manifest; None: each result has the G-code, see `SlicedFile.read`.
        resume: keep what the manifest has, and slice the rest.

    Returns:
        One result for each part and combination; a part that cannot be sliced has a result with a `problem`.

    Raises:
        UsageError: a file cannot be read, or an argument or a setting is invalid.
        OutputError: a file cannot be written.
    """
    check_argument("parts", parts, (list, tuple))
    if jobs is not None and jobs < 1:
        raise UsageError(f"jobs={jobs}: must be at least 1", remedy="Leave it out for one per processor")
    if resume and output_dir is None:
        raise UsageError(
            "resume needs an output_dir", remedy="Give the folder of the batch that was interrupted"
        )
    tasks = _list_tasks([Path(part) for part in parts], settings or {})
    folder = None if output_dir is None else Path(output_dir)
    if folder is not None:
        make_folder(folder)
    if executor is not None:
        return _run(tasks, use_executor(executor), folder, resume)
    with open_workers(jobs or count_processors(), "", _LIMITS) as workers:
        return _run(tasks, workers, folder, resume)


def _run(
    tasks: Sequence[BatchTask], workers: Workers, folder: Path | None, resume: bool
) -> tuple[BatchResult, ...]:
    """Run tasks."""
    return run_batch(tasks, workers, folder, resumes=resume)


def _list_tasks(paths: Sequence[Path], settings: Mapping[str, object]) -> list[BatchTask]:
    """Return a task for each part and combination of settings."""
    lists = {key: value for key, value in settings.items() if isinstance(value, list)}
    if empty := [key for key, values in lists.items() if not values]:
        raise UsageError(f"{empty[0]}: the list has no values", remedy="Leave it out, or give some")
    return list_tasks(paths, [_combine(settings, chosen) for chosen in combine_choices(lists)])


def _combine(settings: Mapping[str, object], chosen: Mapping[str, object]) -> Combination:
    """Return the profile of a combination of settings."""
    own = {**settings, **chosen}
    names: dict[str, Any] = {kind: own.pop(kind, None) for kind in KINDS}
    profile, _ = load_slice_profile(own, **names)
    keeps = "planner" in own or chooses_layer_height(key.replace("__", ".") for key in own)
    texts = {key: str(value) for key, value in chosen.items()}
    return Combination(texts, profile, keeps, names["quality"] is not None)
