"""Bodies of requests and answers of `/v1` that are no values of the queue."""

from __future__ import annotations

from typing import Literal

from printer_slicer.print_queue import FileFacts, PrintRun, QueuedFile, QueuedJob
from printer_slicer.server.access import SLICER_SCOPES, ApiKey, Permission
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
]


class JobBody(Struct, frozen=True, forbid_unknown_fields=True):
    """A file to print; the other fields are those of `JobRequest`."""

    file: str
    name: str = ""
    printer: str = ""
    material: str = ""
    allow: tuple[str, ...] = ()
    held: bool = False
    first: bool = False
    copies: int = 1


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
    scopes: frozenset[Permission] = SLICER_SCOPES
    printer: str = ""


class NewKey(Struct, frozen=True):
    """A new key with its text, which is shown only once."""

    key: ApiKey
    text: str


class Account(Struct, frozen=True):
    """Who sent the request, and what is allowed."""

    name: str
    scopes: tuple[Permission, ...]
    printer: str


class JobDetails(Struct, frozen=True):
    """A job with its file and its runs."""

    job: QueuedJob
    file: QueuedFile
    facts: FileFacts | None
    runs: tuple[PrintRun, ...]
