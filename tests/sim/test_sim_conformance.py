"""What real firmware said, word for word; see transcripts/README.md for how it is written down."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from sim_console import Console, numbered

from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.machine import Machine

FOLDER = Path(__file__).parent / "transcripts"
FILES = sorted(FOLDER.glob("*.txt"))
CLOSE = 0.05


@dataclass
class Talk:
    """One conversation: where it stands, with whom, and its lines."""

    name: str
    firmware: str
    machine: Machine
    lines: list[str]


def talks(path: Path) -> Iterator[Talk]:
    """The conversations of a file."""
    head, *parts = re.split(r"(?m)^== ", path.read_text("utf-8"))
    told = dict(line.split(": ", 1) for line in head.splitlines() if ": " in line and line[0] != "#")
    changes = {name: float(value) for name, value in re.findall(r"(\w+)=(\S+)", told.get("machine", ""))}
    for part in parts:
        name, *lines = part.splitlines()
        wanted = [line for line in lines if line.strip() or line.startswith("@")]
        yield Talk(
            f"{path.stem}: {name}",
            told["firmware"],
            replace(Machine(), **changes),  # type: ignore[arg-type]
            wanted,
        )


TALKS = [talk for path in FILES for talk in talks(path)]


def as_sent(line: str) -> str:
    """A line with its checksum put in."""
    match = re.fullmatch(r"N(-?\d+) (.*)\*([?!])", line)
    if not match:
        return line
    right = numbered(int(match[1]), match[2])
    body, _, check = right.rpartition("*")
    return right if match[3] == "?" else f"{body}*{int(check) ^ 1}"


def agrees(heard: str, wanted: str, *, pattern: bool) -> bool:
    """Whether a line is the wanted one."""
    return re.fullmatch(wanted, heard) is not None if pattern else heard == wanted


class Actor:
    """Plays the host's part, and listens."""

    def __init__(self, talk: Talk) -> None:
        firmware = SIMULATED_FIRMWARES[talk.firmware]
        self.console = Console(firmware, talk.machine)
        self.heard: list[tuple[float, str]] = []
        self.unhomed_motors = True

    def done(self) -> None:
        """Nothing may be left that was not expected."""
        assert self.unhomed_motors or not self.heard, f"also said: {self.heard}"
        self.heard, self.unhomed_motors = [], False

    def say(self, lines: list[str]) -> None:
        self.done()
        self.heard = [(0.0, line) for line in self.console.say(*map(as_sent, lines))]

    def wait(self, seconds: float) -> None:
        # What costs the main loop time is said a little later than at once.
        self.heard = [*self.heard, *self.console.wait(seconds)]

    def expect(self, wanted: str, *, pattern: bool, at: str = "") -> None:
        assert self.heard, f"nothing is said, but should be: {wanted}"
        seconds, line = self.heard.pop(0)
        assert agrees(line, wanted, pattern=pattern), f"{line!r} is said, and should be: {wanted}"
        if at:
            right = agrees(f"{seconds:.2f}", at, pattern=True) or abs(seconds - float(at)) < CLOSE
            assert right, f"{line!r} is said after {seconds:.2f} s, and should be after {at}"

    def plant(self, heater: str, reads: float) -> None:
        state = self.console.printer.state
        state.heaters.find_heater(heater).set_fault(self.console.now, stuck_at=reads)
        state.record_heater_fault(heater)

    def act(self, line: str) -> None:
        """Do what one line of a conversation says."""
        mark, _, rest = line.partition(" ")
        if mark == "<!":
            assert not self.heard, "nothing should be said"
        elif mark.startswith("<"):
            self.expect(rest, pattern=mark == "<~")
        elif mark.startswith("@"):
            at, _, wanted = rest.partition(" ")
            self.expect(wanted, pattern=mark == "@~", at=at)
        elif mark == "wait":
            self.wait(float(rest))
        elif mark == "fault:":
            _, heater, _, reads = rest.split()
            self.plant(heater, float(reads))
        else:
            assert mark == "..."
            self.unhomed_motors = True


@pytest.mark.parametrize("talk", TALKS, ids=lambda talk: talk.name)
def test_it_says_what_the_firmware_said(talk: Talk) -> None:
    actor = Actor(talk)
    said: list[str] = []
    for line in talk.lines:
        if line.startswith(">"):
            said.append(line[2:])
            continue
        if said:
            actor.say(said)
            said = []
        actor.act(line)
    actor.done()


def test_every_file_and_every_conversation_is_there() -> None:
    assert {path.stem for path in FILES} == {
        *("klipper", "marlin_2_0_avr", "marlin_2_1", "marlin_2_1_advanced", "octoprint_virtual")
    }
    assert len(TALKS) > 40
    assert len({talk.name for talk in TALKS}) == len(TALKS)
