"""Tasks of a batch, each one model with one set of settings, and their results: G-code files and facts."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, Literal
from zlib import decompress

from printer_slicer.batching.matrix import name_choices
from printer_slicer.errors import PrinterSlicerError, UsageError
from printer_slicer.input_files import read_pieces
from printer_slicer.profile import Profile, settings_as_dict
from printer_slicer.values import Struct, as_dict
from printer_slicer.version import VERSION

__all__ = [
    "BatchResult",
    "BatchTask",
    "Combination",
    "ModelOptions",
    "SlicedFile",
    "TaskModel",
    "describe_error",
    "fail_task",
    "list_tasks",
    "make_unique",
    "read_task_model",
]


_MAX_NAME: Final = 200  # bytes of the name of a file, without number and suffix

_MAX_TASKS: Final = 100_000


class TaskModel(Struct, frozen=True):
    """A file with a model.

    Attributes:
        name: name of the file, without folder.
        sha256: hash of the content.
        size: bytes.
        path: where workers on this machine read it; empty: they take `content`.
        content: the content, for workers on other machines.
    """

    name: str
    sha256: str
    size: int
    path: str = ""
    content: bytes = b""

    def with_content(self) -> TaskModel:
        """Return the file with its content instead of its path.

        Raises:
            UsageError: the file cannot be read, or has changed.
        """
        return self._read_again(keeps_content=True)

    def check_file(self) -> None:
        """Check that the file is still what it was when the task was made.

        Raises:
            UsageError: the file cannot be read, or has changed.
        """
        self._read_again(keeps_content=False)

    def _read_again(self, *, keeps_content: bool) -> TaskModel:
        """Read the file, and compare it."""
        found = read_task_model(Path(self.path), keeps_content=keeps_content)
        if found.sha256 != self.sha256:
            raise UsageError(
                f"{self.path}: the file has changed since the batch began",
                remedy="Resume the batch to slice it",
            )
        return found


def read_task_model(path: Path, *, keeps_content: bool = False) -> TaskModel:
    """Return a file with its hash, and with its content or its path.

    Raises:
        UsageError: the file cannot be read.
    """
    digest, pieces, size = sha256(), list[bytes](), 0
    try:
        for piece in read_pieces(path):
            digest.update(piece)
            size += len(piece)
            if keeps_content:
                pieces.append(piece)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror or error}", remedy="Check the path") from None
    where = "" if keeps_content else str(path.absolute())
    return TaskModel(path.name, digest.hexdigest(), size, where, b"".join(pieces))


class ModelOptions(Struct, frozen=True):
    """What happens to a model before it is sliced.

    Attributes:
        units: unit of its coordinates; None: that of the file.
        scale: factors for x, y and z.
        rotate: degrees about x, y and z.
        orient: search for an orientation.
        keep_up: largest tilt of the z axis in this search, degrees.
        copies: number of copies, which are arranged.
    """

    units: str | None = None
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rotate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orient: Literal["off", "fast", "careful"] = "off"
    keep_up: float = 180.0
    copies: int = 1


_UNCHANGED: Final = ModelOptions()


class BatchTask(Struct, frozen=True):
    """One model with one set of settings.

    Attributes:
        name: name of the G-code file without suffix, unique in a batch.
        model: the file.
        profile: printer, material and quality.
        options: what happens to the model before it is sliced.
        choices: the settings in which the tasks of a batch differ, as text.
        strict: a mesh that needs repair, or unsupported extrusion, is an error.
        keeps_layer_height: whether the user chose a layer height, see `apply_project_settings`.
        has_quality: whether the user chose a quality, see `apply_project_settings`.
        has_picture: whether a picture of the part is made.
        folder: where the worker writes the files; empty: the result contains them.
        max_seconds: time after which the task is stopped.
    """

    name: str
    model: TaskModel
    profile: Profile
    options: ModelOptions = _UNCHANGED
    choices: Mapping[str, str] = {}
    strict: bool = False
    keeps_layer_height: bool = False
    has_quality: bool = True
    has_picture: bool = False
    folder: str = ""
    max_seconds: float = 3600.0

    @property
    def key(self) -> str:
        """Hash of all that the G-code depends on: content of the model, settings, and version of this package."""
        facts = [
            VERSION,
            self.model.name,
            self.model.sha256,
            as_dict(self.options),
            self.strict,
            self.keeps_layer_height,
        ]
        text = json.dumps([*facts, settings_as_dict(self.profile)], sort_keys=True)
        return sha256(text.encode()).hexdigest()


class SlicedFile(Struct, frozen=True):
    """A file of G-code: one plate.

    Attributes:
        name: name of the file.
        sha256: hash of its content.
        size: bytes.
        facts: what `slice --json` tells about it.
        content: the content compressed with zlib, if the worker did not write it.
    """

    name: str
    sha256: str
    size: int
    facts: Mapping[str, Any]
    content: bytes = b""

    def read(self) -> bytes:
        """Return the G-code, if the worker did not write it to a file."""
        return decompress(self.content)


class BatchResult(Struct, frozen=True):
    """The result of a task.

    Attributes:
        task: name of the task.
        key: key of the task.
        model: name of the model file.
        model_sha256: hash of its content.
        choices: the settings in which the tasks of the batch differ.
        problem: why it failed; empty if it is done.
        warnings: sentences.
        files: files of G-code, one per plate.
        seconds: time that the worker needed.
        picture: the part as PNG; empty without one.
    """

    task: str
    key: str
    model: str
    model_sha256: str
    choices: Mapping[str, str] = {}
    problem: str = ""
    warnings: tuple[str, ...] = ()
    files: tuple[SlicedFile, ...] = ()
    seconds: float = 0.0
    picture: bytes = b""

    def total(self, fact: str) -> float:
        """Return the sum of a fact over all plates, such as `seconds`."""
        return float(sum(one.facts[fact] for one in self.files))

    def find_largest(self, fact: str) -> float:
        """Return the largest value of a fact of the certificate over all plates, such as `max_error_mm`."""
        return float(max((one.facts["certificate"][fact] for one in self.files), default=0.0))


class Combination(Struct, frozen=True):
    """One combination of the settings in which tasks differ.

    Attributes:
        choices: these settings, as text.
        profile: the profile with them.
        keeps_layer_height: whether the user chose a layer height, see `apply_project_settings`.
        has_quality: whether the user chose a quality, see `apply_project_settings`.
    """

    choices: Mapping[str, str]
    profile: Profile
    keeps_layer_height: bool = False
    has_quality: bool = True


def list_tasks(
    paths: Sequence[Path],
    combinations: Sequence[Combination],
    options: ModelOptions = _UNCHANGED,
    **more: Any,
) -> list[BatchTask]:
    """Return a task for each model and combination of settings.

    Args:
        paths: the models; a path that occurs twice counts once.
        combinations: at least one.
        options: what happens to each model before it is sliced.
        **more: further fields of each task.

    Raises:
        UsageError: a model cannot be read, or there are too many tasks.
    """
    paths = list(dict.fromkeys(paths))
    if (count := len(paths) * len(combinations)) > _MAX_TASKS:
        raise UsageError(f"{count} tasks; the most are {_MAX_TASKS}", remedy="Give fewer models or values")
    models = [read_task_model(path) for path in paths]
    rows = [(model, one) for model in models for one in combinations]
    names = [
        _shorten("-".join(filter(None, (name, name_choices(one.choices)))))
        for name in _name_models(models)
        for one in combinations
    ]
    has_plates = options.copies > 1 or options.orient != "off"
    return [
        BatchTask(
            name,
            model,
            one.profile,
            options,
            one.choices,
            keeps_layer_height=one.keeps_layer_height,
            has_quality=one.has_quality,
            **more,
        )
        for name, (model, one) in zip(make_unique(names, has_plates=has_plates), rows, strict=True)
    ]


def _name_models(models: Sequence[TaskModel]) -> list[str]:
    """Return the name of each model's G-code: that of the file, with its folder if others have the same one."""
    paths = [Path(model.path) for model in models]
    counts = Counter(path.stem.casefold() for path in paths)
    return [
        path.stem if counts[path.stem.casefold()] == 1 else f"{path.parent.name}-{path.stem}"
        for path in paths
    ]


def _shorten(name: str) -> str:
    """Return a name that leaves room for a number and a suffix in the name of a file."""
    if len(os.fsencode(name)) <= _MAX_NAME:
        return name
    digest = sha256(os.fsencode(name)).hexdigest()[:12]
    return f"{os.fsencode(name)[: _MAX_NAME - 13].decode('utf-8', 'ignore')}-{digest}"


def make_unique(names: Sequence[str], *, has_plates: bool) -> list[str]:
    """Add numbers to names, so that no file has the name of another one, also where case does not count.

    Args:
        names: of tasks.
        has_plates: whether a task may have several files, such as `lid-1` and `lid-2` for `lid`.
    """
    given = {name.casefold() for name in names}
    taken, numbers = dict[str, str](), Counter[str]()
    for name in names:
        found = name
        while (
            (key := found.casefold()) in taken
            or (found != name and key in given)
            or (has_plates and _is_plate(key, given))
        ):
            numbers[name] += 1
            found = f"{name}_{numbers[name] + 1}"
        taken[key] = found
    return list(taken.values())


def _is_plate(name: str, others: Collection[str]) -> bool:
    """Return whether a name may be that of a plate of another task."""
    head, _, number = name.rpartition("-")
    return number.isdigit() and head in others


def fail_task(task: BatchTask, problem: str) -> BatchResult:
    """Return the result of a task that failed."""
    return BatchResult(task.name, task.key, task.model.name, task.model.sha256, task.choices, problem)


def describe_error(error: PrinterSlicerError) -> str:
    """Return what is wrong and what to do, in one line."""
    return str(error).replace("\n  ", ". ")
