"""All errors that this package raises for users, and their exit codes.

    PrinterSlicerError                1
    ├── UsageError                    2   an option, a name or a setting is invalid
    │   ├── ProfileError              2   a profile is invalid; the message names file, key and limit
    │   ├── PolicyError               2   the job contains a command that is not allowed
    │   └── StrategyError             2   a user's function returned an invalid value
    ├── PartError                     3   the part cannot be sliced
    │   ├── MeshError                 3   the file is not a usable mesh
    │   └── PlanError                 3   no layer plan exists within the machine's limits
    ├── OutputError                   2   the output cannot be written
    ├── PortError                     4   the port is missing, busy, not permitted, or was disconnected
    ├── PrintError                    5   the printer stopped before the end of the job
    ├── Cancelled                     6   the user stopped the work
    └── VerificationError             7   the executed commands differ from the job

The message says what is wrong and where; `remedy` says what to do.
"""

from __future__ import annotations

__all__ = [
    "Cancelled",
    "MeshError",
    "OutputError",
    "PartError",
    "PlanError",
    "PolicyError",
    "PortError",
    "PrintError",
    "PrinterSlicerError",
    "ProfileError",
    "StrategyError",
    "UsageError",
    "VerificationError",
]


class PrinterSlicerError(Exception):
    """Base class of all errors of this package, with a message, a remedy and an exit code."""

    exit_code = 1

    def __init__(self, message: str, *, remedy: str = "") -> None:
        super().__init__(message)
        self.remedy = remedy

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message}\n  {self.remedy}" if self.remedy else message


class UsageError(PrinterSlicerError):
    """An option, a name or a setting is invalid."""

    exit_code = 2


class ProfileError(UsageError):
    """A profile is invalid; the message names file, key and limit."""


class PolicyError(UsageError):
    """A job contains commands that are not allowed; `names` lists the findings to pass to `Job.allowing`."""

    def __init__(self, message: str, *, remedy: str = "", names: tuple[str, ...] = ()) -> None:
        super().__init__(message, remedy=remedy)
        self.names = names


class StrategyError(UsageError):
    """A user's planner, infill, flavour or post-processor returned an invalid value."""


class OutputError(PrinterSlicerError):
    """The output cannot be written."""

    exit_code = 2


class PartError(PrinterSlicerError):
    """The part cannot be sliced."""

    exit_code = 3


class MeshError(PartError):
    """The mesh does not bound a solid."""


class PlanError(PartError):
    """No layer plan exists within the machine's limits."""


class PortError(PrinterSlicerError):
    """The port is missing, busy, not permitted, or was disconnected."""

    exit_code = 4


class PrintError(PrinterSlicerError):
    """The printer stopped before the end of the job."""

    exit_code = 5


class Cancelled(PrinterSlicerError):  # noqa: N818 - the user's decision, not an error
    """The user stopped the work."""

    exit_code = 6


class VerificationError(PrinterSlicerError):
    """The executed commands differ from the job."""

    exit_code = 7
