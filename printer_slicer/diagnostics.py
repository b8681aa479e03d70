"""What a job holds that a machine or its settings could suffer from, and under which name it passes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from printer_slicer.errors import PolicyError, UsageError

__all__ = ["NAMES", "Finding", "check_names", "insist", "remedy_of", "sentence"]

_TOLD: Final = 12  # findings told in full in one error

NAMES: Final[Mapping[str, str]] = {
    "temperature": "heating over the profile's ceilings, or to values that cannot be read",
    "box": "moves out of the machine",
    "feed": "speeds far over the profile's",
    "flow": "more plastic per second than the material's max_flow",
    "ratio": "flow or speed override far from 100 % (M221, M220)",
    "unsupported": "unsupported extrusion: nothing is under it",
    "cold": "extrusion below the firmware's minimum temperature (M302, or no heating before it)",
    "homing": "moves before homing, extrusion after the motors were switched off",
    "eeprom": "storing, loading or resetting the firmware's settings (M500, M501, M502, M504, SAVE_CONFIG)",
    "limits": "limits of speed, acceleration and jerk far over the profile's (M201 to M205)",
    "calibration": "steps, currents, geometry and control loops (M92, M301, M304, M350, M665, M906 and others)",
    "autotune": "heating by itself to tune a heater (M303)",
    "protection": "what guards the heaters (M143, M562, M570)",
    "endstops": "moves beyond the endstops (M211 S0, M564)",
    "offsets": "another origin, which makes the box unknown (M206, M290, M428, M851, G10 L2, G54 to G59)",
    "halt": "halting the machine (M112, M410); power off (M81) is only told",
    "wait": "waiting for a person without end (M0, M1)",
    "firmware": "updating or restarting the firmware (M997, M999, FIRMWARE_RESTART)",
    "files": "reading, writing or deleting files of the printer (M23, M24, M28, M30, M32, M928)",
    "pins": "switching pins of the board directly (M42, M43)",
    "macros": "storing commands that run later (M810 to M819)",
    "link": "the serial port, line numbers, answers, the printer's network (M575, M110, M118 ok, M552, M586 to M589)",
    "debug": "commands for developers (D0 and others, M111)",
    "shell": "programs of the printer's computer (RUN_SHELL_COMMAND)",
    "unreadable": "unparsed commands: expressions, several commands in a line, bare letters, lower case, G5, G18",
}
"""Name -> what it allows."""

_NAME_IT: Final = "name the printer it was made for with --printer and --material"
_REMEDIES: Final[Mapping[str, str]] = {
    **dict.fromkeys(("temperature", "box", "feed", "flow", "limits", "unreadable"), _NAME_IT),
    "unsupported": "turn the part or add supports",
    "cold": "heat the nozzle first (M109 S and a temperature) and remove M302",
    "homing": "home first (G28) and keep the motors on",
}
"""Name -> remedy; another profile helps only against what is compared with a profile."""

_OTHERS: Final = "remove it from the G-code"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing found in a job.

    Attributes:
        name: what it is allowed by, a key of `NAMES`; findings that are only told have one too.
        refused: whether the job is not printed unless the name is allowed; otherwise it is only told.
        index: of the first command that does it.
        command: that command.
        what: it does, with numbers.
        why: that matters.
        times: how often the job does it.
        line: of the text, counted from 1; 0 if not known.
        layer: counted from 1; 0 before the first.
    """

    name: str
    refused: bool
    index: int
    command: str
    what: str
    why: str
    times: int = 1
    line: int = 0
    layer: int = 0

    def __post_init__(self) -> None:
        assert self.name in NAMES, self.name


def sentence(finding: Finding) -> str:
    """One finding in one line, for people."""
    where = f"line {finding.line}" if finding.line else f"command {finding.index + 1}"
    layer = f", layer {finding.layer}" if finding.layer else ""
    more = f", and {finding.times - 1} more times" if finding.times > 1 else ""
    return f"{where}{layer}: {finding.command}: {finding.what}{more}; {finding.why} [{finding.name}]"


def check_names(allowed: Iterable[str]) -> frozenset[str]:
    """The names, all of which exist.

    Raises:
        UsageError: one does not.
    """
    names = frozenset(allowed)
    if wrong := sorted(names - set(NAMES)):
        raise UsageError(
            f"--allow {wrong[0]}: nothing is allowed by that name", remedy=f"names are {', '.join(NAMES)}"
        )
    return names


def remedy_of(findings: Iterable[Finding]) -> str:
    """Return the remedies of the refused findings and the flags that allow them."""
    names = tuple(dict.fromkeys(one.name for one in findings if one.refused))
    by_remedy: dict[str, list[str]] = {}
    for name in names:
        by_remedy.setdefault(_REMEDIES.get(name, _OTHERS), []).append(name)
    several = len(by_remedy) > 1
    helps = [f"{', '.join(of)}: {remedy}" if several else remedy for remedy, of in by_remedy.items()]
    meant = "if they are meant" if len(names) > 1 else "if it is meant"
    return "; ".join([*helps, f"{meant}: {' '.join(f'--allow {name}' for name in names)}"])


def insist(
    findings: Sequence[Finding],
    allowed: Collection[str] = (),
    *,
    name: str = "job",
    refusal: str = "not printed",
) -> None:
    """Refuse a job that holds something which was not allowed.

    Args:
        findings: of the whole job.
        allowed: names.
        name: of the job, for the message.
        refusal: what does not happen to it, for the message.

    Raises:
        PolicyError: it does; says what, where, and how to allow it.
    """
    wrong = [one for one in findings if one.refused and one.name not in allowed]
    if not wrong:
        return
    said = [sentence(one) for one in wrong[:_TOLD]]
    said += [f"... and {len(wrong) - _TOLD} more"] if len(wrong) > _TOLD else []
    raise PolicyError(
        f"{name}: {refusal}, for it holds\n  " + "\n  ".join(said),
        remedy=remedy_of(wrong),
        names=tuple(dict.fromkeys(one.name for one in wrong)),
    )
