"""Slice a model that was uploaded, in a process of its own: load the profile, and slice as `batch` does."""

from __future__ import annotations

from collections.abc import Mapping

from printer_slicer.batching.pool import slice_and_report
from printer_slicer.batching.tasks import BatchResult, BatchTask, ModelOptions, TaskModel
from printer_slicer.project_settings import chooses_layer_height
from printer_slicer.values import Struct

__all__ = ["UploadedModel", "slice_upload"]


class UploadedModel(Struct, frozen=True):
    """A model that was uploaded, and how it is sliced.

    Attributes:
        task: id of the task.
        model: the file.
        names: printer, material and quality; without one, the default.
        settings: changed settings, as for `--set`.
        copies: number of copies.
        folder: folder for the G-code, which exists.
    """

    task: str
    model: TaskModel
    names: Mapping[str, str]
    settings: Mapping[str, str]
    copies: int
    folder: str


def slice_upload(upload: UploadedModel) -> BatchResult:
    """Slice a model, and write its G-code.

    Raises:
        UsageError: a profile or a setting is wrong.
    """
    from printer_slicer.importing.familiar import load_profile  # noqa: PLC0415 - the server loads no numpy

    printer, material, quality = (upload.names.get(kind) for kind in ("printer", "material", "quality"))
    profile = load_profile(printer, material, quality, changes=upload.settings)
    task = BatchTask(
        upload.task,
        upload.model,
        profile,
        ModelOptions(copies=upload.copies),
        keeps_layer_height=chooses_layer_height(upload.settings),
        has_quality="quality" in upload.names,
        folder=upload.folder,
    )
    return slice_and_report(task)
