"""Every error that people meet, and the exit code it becomes.

    PrinterSlicerError                1
    ├── UsageError                    2   a flag, a name, a setting
    │   ├── ProfileError              2   a profile: file, key, bound
    │   ├── PolicyError               2   the job holds what was not allowed
    │   └── StrategyError             2   a function passed from outside gave what cannot be used
    ├── PartError                     3   the part cannot be sliced
    │   ├── MeshError                 3   the file is not a usable mesh
    │   └── PlanError                 3   no layer plan exists within the machine's limits
    ├── OutputError                   2   the output cannot be written
    ├── PortError                     4   no such port, busy, not allowed, gone
    ├── PrintError                    5   the printer stopped; carries a checkpoint
    ├── Cancelled                     6   a person stopped it
    └── VerificationError             7   what was executed is not what was asked for

A message says what is wrong and where; `remedy` says what to do about it.
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
    """Base of all errors of this package: one message, one remedy, one exit code."""

    exit_code = 1

    def __init__(self, message: str, *, remedy: str = "") -> None:
        super().__init__(message)
        self.remedy = remedy

    def __str__(self) -> str:
        message = super().__str__()
        return f"{message}\n  {self.remedy}" if self.remedy else message


class UsageError(PrinterSlicerError):
    """A flag, a name or a setting that makes no sense."""

    exit_code = 2


class ProfileError(UsageError):
    """A profile that cannot be used: names file, key and bound."""


class PolicyError(UsageError):
    """A job that is not printed, for it holds what was not allowed; `names` are what would allow it."""

    def __init__(self, message: str, *, remedy: str = "", names: tuple[str, ...] = ()) -> None:
        super().__init__(message, remedy=remedy)
        self.names = names


class StrategyError(UsageError):
    """A planner, infill, flavour or post-processor that was passed as a function gave what cannot be used."""


class OutputError(PrinterSlicerError):
    """The result cannot be written where it was asked for."""

    exit_code = 2


class PartError(PrinterSlicerError):
    """The part cannot be sliced."""

    exit_code = 3


class MeshError(PartError):
    """The file is not a mesh that bounds a solid."""


class PlanError(PartError):
    """No layer plan exists within the machine's limits."""


class PortError(PrinterSlicerError):
    """The port is missing, busy, not allowed, or went away."""

    exit_code = 4


class PrintError(PrinterSlicerError):
    """The printer stopped before the job was done."""

    exit_code = 5


class Cancelled(PrinterSlicerError):  # noqa: N818 - not a fault, a person's wish
    """A person stopped the work."""

    exit_code = 6


class VerificationError(PrinterSlicerError):
    """What was executed is not what was asked for."""

    exit_code = 7
