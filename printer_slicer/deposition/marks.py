"""What comments tell about the commands of a job, and what goes wrong with the extrusion of one."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.deposition.purposes import Purpose, purpose_of
from printer_slicer.geometry import Int

__all__ = ["Marks", "Mishap", "marks_of"]

_TOOL: Final = re.compile(rb"[Tt]\d{1,3}\b")
_OTHER_TOOL: Final = re.compile(rb"^[ \t]*(?:N\d+[ \t]*)?[Tt]0*[1-9]", re.MULTILINE)

_SPOKEN: Final = {
    Purpose.UNKNOWN: "printing",
    Purpose.SPARSE: "sparse infill",
    Purpose.GAP: "gaps and thin walls",
    Purpose.BESIDE: "skirt, brim, priming",
    Purpose.SUPPORT: "support and raft",
}
"""Purposes of beads in words that say enough by themselves."""


class Mishap(NamedTuple):
    """Something that went wrong with the material.

    Attributes:
        kind: "air", "crash", "bed" or "flow".
        command: that did it, as the printer counts them from 1.
        layer: see `Marks.layer`.
        z, x, y: mm, where.
        amount: mm in the air, mm gone through, mm over the bed, mm³/s.
        depth: mm, of a crash.
    """

    kind: str
    command: int
    layer: int
    z: float
    x: float
    y: float
    amount: float
    depth: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Marks:
    """What comments tell about commands, as the printer counts them.

    Attributes:
        layers: (M,) commands at which a layer begins, ascending; empty where nothing tells: then heights are counted.
        roles: (R,) commands from which on beads have another name.
        names: (R,) index into `spoken` of each.
        spoken: names; the first is that of beads without one.
        loose: names of what is taken off the part again.
        changes: (T,) commands that choose a tool.
        tools: (T,) the tool of each; before the first it is 0.
    """

    layers: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    roles: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    names: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    spoken: tuple[str, ...] = ("printing",)
    loose: frozenset[int] = frozenset()
    changes: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    tools: Int = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def told(self) -> bool:
        """Whether comments name beads at all."""
        return len(self.roles) > 0

    def role(self, command: Int) -> Int:
        """(n,) the name of what each command lays."""
        at = np.searchsorted(self.roles, command, side="right")
        return np.append(0, self.names)[at]

    def tool(self, command: Int) -> Int:
        """(n,) the tool of each command."""
        return np.append(0, self.tools)[np.searchsorted(self.changes, command, side="right")]

    def layer(self, command: Int) -> Int:
        """(n,) the layer of each command, counted from 1; 0 before the first."""
        return np.searchsorted(self.layers, command, side="right")


def marks_of(
    commands: Sequence[bytes], text: bytes, layers_at: Mapping[int, int], roles_at: Mapping[int, str]
) -> Marks:
    """What the comments of a job tell, by commands counted from 1.

    Args:
        commands: of the job.
        text: that they come from.
        layers_at: command index -> layer.
        roles_at: command index -> what extrusion is called from there on.
    """
    layers = np.array(list(layers_at), np.int64) + 1
    roles = {command: purpose_of(name) for command, name in roles_at.items()}
    first = int(layers[0]) - 1 if len(layers) else 0
    if roles and first:
        # What is laid before the first layer primes the nozzle.
        roles = {0: Purpose.BESIDE} | {command: kind for command, kind in roles.items() if command >= first}
    changes, tools = _tools_of(commands, text)
    return Marks(
        layers=layers,
        roles=np.array(list(roles), np.int64) + 1,
        names=np.array([int(kind) for kind in roles.values()], np.int64),
        spoken=tuple(_SPOKEN.get(kind, kind.spoken) for kind in Purpose),
        loose=frozenset({int(Purpose.SUPPORT)}),
        changes=changes,
        tools=tools,
    )


def _tools_of(commands: Sequence[bytes], text: bytes) -> tuple[Int, Int]:
    """Commands, counted from 1, that choose a tool, and which; none where there is no other than the first."""
    if not _OTHER_TOOL.search(text):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = [
        (at, int(command[1:].split()[0])) for at, command in enumerate(commands, 1) if _TOOL.match(command)
    ]
    return np.array([at for at, _ in found], np.int64), np.array([tool for _, tool in found], np.int64)
