"""Bodies of requests and answers of `/v1` that are no values of the queue."""

from __future__ import annotations

from typing import Literal

from printer_slicer.print_queue import FileFacts, JobRequest, PrintRun, QueuedFile, QueuedJob
from printer_slicer.server.access import SLICER_SCOPES, ApiKey, KeyScope
from printer_slicer.values import Struct

__all__ = [
    "Account",
    "BedBody",
    "CommandBody",
    "JobBody",
    "JobDetails",
    "KeyBody",
    "MaterialBody",
    "MoveBody",
    "NewKey",
    "PreviewLayers",
    "PrinterInfo",
    "ProfileNames",
]


class JobBody(JobRequest, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A file to print, and what is wanted of its jobs.

    Attributes:
        file: id of the file.
    """

    file: str


class MoveBody(Struct, frozen=True, forbid_unknown_fields=True):
    """Before which job a job is moved; None: to the end."""

    before: int | None = None


class BedBody(Struct, frozen=True, forbid_unknown_fields=True):
    """The state of a bed, as a person sees it."""

    bed: Literal["clear", "occupied", "unknown"]


class MaterialBody(Struct, frozen=True, forbid_unknown_fields=True):
    """The name of the material that is loaded."""

    material: str


class CommandBody(Struct, frozen=True, forbid_unknown_fields=True):
    """A command to a running print, in the words of `printer-slicer control`."""

    command: str


class KeyBody(Struct, frozen=True, forbid_unknown_fields=True):
    """A key to create."""

    name: str
    scopes: frozenset[KeyScope] = SLICER_SCOPES
    printer: str = ""


class NewKey(Struct, frozen=True):
    """A new key with its text, which is shown only once."""

    key: ApiKey
    text: str


class Account(Struct, frozen=True):
    """Who sent the request, and what is allowed."""

    name: str
    scopes: tuple[KeyScope, ...]
    printer: str


class PreviewLayers(Struct, frozen=True):
    """The layers of a file in printing order, one row each.

    Attributes:
        first: first move in the preview.
        z: top, mm.
        height: mm.
        seconds: time of the moves, s.
        command: index of the command of the first move, among the commands of the file.
    """

    first: tuple[int, ...]
    z: tuple[float, ...]
    height: tuple[float, ...]
    seconds: tuple[float, ...]
    command: tuple[int, ...]


class ProfileNames(Struct, frozen=True):
    """The names of the profiles of each kind, sorted."""

    printer: tuple[str, ...]
    material: tuple[str, ...]
    quality: tuple[str, ...]


class PrinterInfo(Struct, frozen=True):
    """What printers.toml says of a printer, without its port."""

    name: str
    profile: str
    groups: tuple[str, ...]
    webcam: str
    webcam_interval: float


class JobDetails(Struct, frozen=True):
    """A job with its file and its runs."""

    job: QueuedJob
    file: QueuedFile
    facts: FileFacts | None
    runs: tuple[PrintRun, ...]
