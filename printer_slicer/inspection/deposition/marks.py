"""Layers, roles and tools of a job's commands, read from comments; and defects of its extrusion."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.gcode.lexer import parse
from printer_slicer.inspection.deposition.support_gaps import USUAL_GAPS, SupportGaps
from printer_slicer.roles import ROLES
from printer_slicer.values import Struct, field

__all__ = ["NOT_PART", "Defect", "Marks", "Purpose", "marks_of", "purpose_of", "purposes_of_roles"]


class Purpose(IntEnum):
    """Role of an extrusion, read from the comments of any slicer; `label` is its `;TYPE:` name."""

    UNKNOWN = 0
    EXTERNAL_PERIMETER = 1
    PERIMETER = 2
    OVERHANG_PERIMETER = 3
    SOLID_INFILL = 4
    BRIDGE = 5
    INTERNAL_INFILL = 6
    GAP_FILL = 7
    IRONING = 8
    SUPPORT_MATERIAL = 9
    SKIRT = 10
    TOP_SOLID_INFILL = 11
    CUSTOM = 12

    @property
    def label(self) -> str:
        """Name of the role for users, which PrusaSlicer writes in `;TYPE:` comments."""
        return _LABELS.get(self, self.name.capitalize().replace("_", " "))


NOT_PART: Final = (Purpose.SUPPORT_MATERIAL, Purpose.SKIRT, Purpose.CUSTOM)
"""Purposes of extrusions that do not belong to the part."""

_LABELS: Final = {Purpose.BRIDGE: "Bridge infill", Purpose.SKIRT: "Skirt/Brim"}

# Role names of slicers, in lower case with spaces; the first entry that a name starts with applies.
# PrusaSlicer and SuperSlicer; OrcaSlicer and Bambu Studio; CuraEngine.
_ROLE_NAMES: Final = (
    ("external perimeter", Purpose.EXTERNAL_PERIMETER),
    ("outer wall", Purpose.EXTERNAL_PERIMETER),
    ("wall outer", Purpose.EXTERNAL_PERIMETER),
    ("overhang", Purpose.OVERHANG_PERIMETER),
    ("perimeter", Purpose.PERIMETER),
    ("inner wall", Purpose.PERIMETER),
    ("wall inner", Purpose.PERIMETER),
    ("internal infill", Purpose.INTERNAL_INFILL),
    ("sparse infill", Purpose.INTERNAL_INFILL),
    ("internal bridge", Purpose.BRIDGE),
    ("bridge", Purpose.BRIDGE),
    ("gap", Purpose.GAP_FILL),
    ("thin wall", Purpose.GAP_FILL),
    ("ironing", Purpose.IRONING),
    ("solid infill", Purpose.SOLID_INFILL),
    ("internal solid infill", Purpose.SOLID_INFILL),
    ("top", Purpose.TOP_SOLID_INFILL),
    ("bottom", Purpose.SOLID_INFILL),
    ("skin", Purpose.SOLID_INFILL),
    ("fill", Purpose.INTERNAL_INFILL),
    ("support", Purpose.SUPPORT_MATERIAL),
    ("skirt", Purpose.SKIRT),
    ("brim", Purpose.SKIRT),
    ("prime", Purpose.CUSTOM),
    ("wipe", Purpose.CUSTOM),
    ("custom", Purpose.CUSTOM),
)


def purpose_of(name: str) -> Purpose:
    """Return the purpose that a slicer means by this role name."""
    plain = re.sub(r"[\W_]+", " ", name.lower()).strip()
    return next((purpose for begin, purpose in _ROLE_NAMES if plain.startswith(begin)), Purpose.UNKNOWN)


_PURPOSE_BY_ROLE: Final = np.array([purpose_of(row.type_comment) for row in ROLES], np.int64)


def purposes_of_roles(roles: Int) -> Int:
    """Return the `Purpose` of each `Role`, (n,)."""
    return np.asarray(_PURPOSE_BY_ROLE[roles])


_SELECTS_OTHER_TOOL: Final = re.compile(rb"^[ \t]*(?:N\d+[ \t]*)?[Tt]0*[1-9]", re.MULTILINE)


class Defect(NamedTuple):
    """A defect of the extrusion: its kind, command, position and amount.

    Attributes:
        kind: "unsupported", "crash", "head", "bed", "flow" or "pressed".
        command: the command that caused it, counted from 1.
        layer: see `Marks.layer_at`.
        z, x, y: mm, its position.
        amount: length of the unsupported or pressed extrusion, or of the collision, mm; height above the bed, or of a
            shape of the head above the nozzle, mm; or flow, mm³/s.
        depth: mm, depth of a collision or contact.
    """

    kind: str
    command: int
    layer: int
    z: float
    x: float
    y: float
    amount: float
    depth: float = 0.0


class Marks(Struct, frozen=True, eq=False):
    """Layers, roles and tools of a job's commands, read from comments, and the gaps of its supports.

    Commands are counted from 1.

    Attributes:
        layers: (M,) commands at which a layer begins, ascending; empty if no comment names layers.
        roles: (R,) commands at which the role changes.
        names: (R,) index into `labels` of each change.
        labels: names of roles; the first is that of extrusion without a role.
        removable: indices of roles that are removed after the print, such as supports.
        changes: (T,) commands that choose a tool.
        tools: (T,) the tool of each; before the first it is 0.
        gaps: of supports, which are no unsupported places.
    """

    layers: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    roles: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    names: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    labels: tuple[str, ...] = (Purpose.UNKNOWN.label,)
    removable: frozenset[int] = frozenset()
    changes: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    tools: Int = field(default_factory=lambda: np.zeros(0, np.int64))
    gaps: SupportGaps = USUAL_GAPS

    @property
    def has_roles(self) -> bool:
        """Whether any comment names a role."""
        return len(self.roles) > 0

    def role_at(self, command: Int) -> Int:
        """Return the role of each command, as an index (n,) into `labels`."""
        at = np.searchsorted(self.roles, command, side="right")
        return np.append(0, self.names)[at]

    def tool_at(self, command: Int) -> Int:
        """Return the tool (n,) of each command."""
        return np.append(0, self.tools)[np.searchsorted(self.changes, command, side="right")]

    def layer_at(self, command: Int) -> Int:
        """Return the layer (n,) of each command, counted from 1; 0 before the first."""
        return np.searchsorted(self.layers, command, side="right")


def marks_of(
    commands: Sequence[bytes],
    text: bytes,
    layers_at: Mapping[int, int],
    roles_at: Mapping[int, str],
    gaps: SupportGaps = USUAL_GAPS,
) -> Marks:
    """Collect the layers, roles and tools of a job's commands from its comments.

    Args:
        commands: of the job.
        text: the source of the commands.
        layers_at: command index -> layer.
        roles_at: command index -> name of the role from there on.
        gaps: of supports.
    """
    layers = np.array(list(layers_at), np.int64) + 1
    roles = {command: purpose_of(name) for command, name in roles_at.items()}
    first = int(layers[0]) - 1 if len(layers) else 0
    if roles and first:
        # Extrusion before the first layer is priming.
        roles = {0: Purpose.CUSTOM} | {command: kind for command, kind in roles.items() if command >= first}
    changes, tools = _find_tool_changes(commands, text)
    return Marks(
        layers=layers,
        roles=np.array(list(roles), np.int64) + 1,
        names=np.array([int(kind) for kind in roles.values()], np.int64),
        labels=tuple(kind.label for kind in Purpose),
        removable=frozenset({int(Purpose.SUPPORT_MATERIAL)}),
        changes=changes,
        tools=tools,
        gaps=gaps,
    )


def _find_tool_changes(commands: Sequence[bytes], text: bytes) -> tuple[Int, Int]:
    """Return the commands that select a tool, counted from 1, and the tools; empty if only tool 0 is used."""
    if not _SELECTS_OTHER_TOOL.search(text):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    found = [
        (at, int(word[1:]))
        for at, command in enumerate(commands, 1)
        if command[:1] in (b"T", b"t") and (word := parse(command)[0])
    ]
    return np.array([at for at, _ in found], np.int64), np.array([tool for _, tool in found], np.int64)
