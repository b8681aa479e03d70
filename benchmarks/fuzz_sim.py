"""Send hostile bytes to the simulated printer with every firmware, and check its replies and its memory.

    python -m benchmarks.fuzz_sim [--streams 100000] [--seed 0] [--firmware NAME]

Each stream consists of some dozen pieces: pure noise, random words of G-code, valid lines with numbers and checksums,
and damaged ones. They are sent whole or in pieces, with pauses, resets and hangs in between. These rules must hold:

- no exception occurs;
- every line that the printer sends matches the grammar of its firmware (`grammar`), and it only echoes text that came
  from the host;
- a printer that was not killed still answers `ok` at the end;
- memory stays bounded.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from dataclasses import replace
from random import Random  # noqa: TID251 - seeded
from time import process_time

from benchmarks.sim_grammar import grammar
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.line_reader import checksum
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["Outcome", "main", "stream"]

MACHINE = replace(Machine(), probe_points=4, card=True, extruders=2, filament_left=3000.0, runout_sensor=True)
BARE = Machine()

_CODES = tuple(
    re.findall(
        r"\S+",
        """
        G0 G1 G2 G3 G4 G10 G11 G20 G21 G28 G29 G90 G91 G92 M0 M1 M17 M18 M20 M21 M22 M23 M24 M25 M26 M27 M28
        M29 M30 M31 M32 M73 M75 M77 M82 M83 M84 M92 M104 M105 M106 M107 M108 M109 M110 M112 M113 M114 M115
        M117 M118 M119 M140 M154 M155 M190 M201 M202 M203 M204 M205 M207 M208 M211 M220 M221 M226 M290 M302
        M400 M410 M486 M503 M524 M566 M600 M601 M876 M900 M999 T0 T1 T7 FIRMWARE_RESTART SET_VELOCITY_LIMIT
        STATUS !!DEBUG:dont_answer
        """,
    )
)
_QUIET = tuple(code for code in _CODES if code not in {"M112", "M28", "M600", "M0", "M1", "M601", "M226"})
_NUMBERS = (
    "0",
    "1",
    "-1",
    "10",
    "200",
    "0.05",
    "1e9",
    "-",
    ".",
    "999999999999",
    "1" * 60,
    "-0.0000001",
    "50.5",
    "7.",
)
_NOISE = bytes(range(256))
_LIKELY = b"GMTNXYZEFSIJRP*;0123456789.- \n\r()\x00\xff\x80="

_WANTED = re.compile(r"(?:Resend: ?|rs N)(\d{1,9})").findall


class Outcome(Exception):  # noqa: N818 - what a stream came to, when it is not good
    """A failure, with everything needed to repeat it."""


def _make_command(chance: Random, codes: tuple[str, ...]) -> str:
    """Return a command with some words, mostly typical of this command."""
    count = chance.randrange(4)
    words = [chance.choice("XYZEFSIJRPTNC") + chance.choice(_NUMBERS) for _ in range(count)]
    words.insert(0, chance.choice(codes))
    if chance.random() < 0.1:
        words.append(chance.choice(("FILE.GCO", "hello", "ACCEL=300", "; note", "(x)", "A1 x", "E1 y")))
    return chance.choice((" ", " ", "", "  ")).join(words)


def _flip_bit(chance: Random, line: bytes) -> bytes:
    """Return a line with one bit flipped."""
    at = chance.randrange(len(line))
    return line[:at] + bytes((line[at] ^ 1 << chance.randrange(8),)) + line[at + 1 :]


class _Session:
    """One stream of bytes for one printer, and the printer's replies."""

    def __init__(self, name: str, seed: int) -> None:
        self.chance = Random(f"{name} {seed}")
        self.name = name
        self.place = f"firmware {name!r}, seed {seed}"
        self.sent_texts: set[str] = set()
        self.executed = 0
        self.now = 0.0
        self.rest = ""
        self.number = 0  # number of the last line sent
        machine = self.chance.choice((MACHINE, BARE))
        self.printer = SimulatedPrinter(
            machine, SIMULATED_FIRMWARES[name], on_executed=self._note, boots=self.chance.random() < 0.5
        )
        self.grammar = grammar(name)

    def _note(self, text: str) -> None:
        self.executed += 1
        if "118" in text:
            self.sent_texts.add(text)

    def send(self, data: bytes) -> None:
        """Send bytes at once or in pieces, and read the replies."""
        step = self.chance.choice((len(data), len(data), 1, 7))
        for at in range(0, len(data), step):
            self.printer.receive(data[at : at + step], self.now)
        self.listen()

    def wait(self, seconds: float) -> None:
        """Let time pass, from event to event."""
        end = self.now + seconds
        while (due := self.printer.wakeup()) is not None and due <= end:
            self.now = max(due, self.now)
            self.listen()
        self.now = end
        self.listen()

    def listen(self) -> str:
        """Read the replies and check every line."""
        heard = self.printer.send(self.now).decode("latin-1")
        *lines, self.rest = (self.rest + heard).split("\n")
        for line in lines:
            if not self.grammar.fullmatch(line) and not any(
                line.rpartition("// ")[2].removeprefix("echo:") in one for one in self.sent_texts
            ):
                raise Outcome(f"{self.place}: said {line!r}")
        if self.chance.random() < 0.7:
            # A host that resends the requested line gets further.
            for wanted in _WANTED(heard):
                self.number = int(wanted) - 1
        return heard

    def make_piece(self, codes: tuple[str, ...]) -> bytes:
        """Return the next bytes to send."""
        chance = self.chance
        draw = chance.random()
        if draw < 0.08:
            return bytes(chance.choice(_NOISE) for _ in range(chance.randrange(1, 300)))
        if draw < 0.2:
            return bytes(chance.choice(_LIKELY) for _ in range(chance.randrange(1, 120)))
        if draw < 0.4:
            return f"{_make_command(chance, codes)}\n".encode("latin-1")
        self.number += chance.choice((1, 1, 1, 1, 1, 1, 1, 1, 0, 2, -3))
        body = f"N{self.number} {_make_command(chance, codes)}".encode("latin-1")
        line = b"%b*%d\n" % (body, checksum(body[:256]))
        return (_flip_bit(chance, line) if chance.random() < 0.1 else line) * chance.choice((1, 1, 1, 1, 2))

    def check_memory(self) -> None:
        """Check that the printer keeps little data."""
        printer = self.printer
        if printer.unread_bytes > 70_000 or len(printer.state.out) > 20_000:
            raise Outcome(
                f"{self.place}: keeps {printer.unread_bytes} bytes and {len(printer.state.out)} lines"
            )

    def check_reply(self) -> None:
        """Check that a printer that was not killed still replies when it has finished its work."""
        printer = self.printer
        printer.reset(self.now) if self.chance.random() < 0.1 else None
        self.send(b"\n")
        before = self.executed
        for _ in range(6):
            self.wait(3.0)
            if printer.state.killed or not printer.has_unanswered_command:
                break
            self.send(b"M108\n" if self.chance.random() < 0.5 else b"\n")
        if (
            printer.state.killed
            or printer.has_unanswered_command
            or printer.state.muted
            or self.chance.random() < 0.5
        ):
            return
        last = f"N0 M110 N0*{checksum(b'N0 M110 N0')}\n".encode()
        self.wait(5.0)
        for _ in range(3):
            self.send(last)
            self.wait(5.0)
        if self.executed == before and not (
            printer.state.card.writing or printer.has_unanswered_command or printer.state.killed
        ):
            raise Outcome(f"{self.place}: accepts no more commands")


def stream(name: str, seed: int) -> int:
    """Send one stream to a firmware and return the number of executed commands.

    Raises:
        Outcome: the printer broke a rule.
    """
    session = _Session(name, seed)
    chance = session.chance
    codes = _CODES if chance.random() < 0.3 else _QUIET
    for _ in range(chance.randrange(4, 40)):
        session.send(session.make_piece(codes))
        draw = chance.random()
        if draw < 0.3:
            session.wait(chance.choice((0.001, 0.1, 1.0, 30.0)))
        elif draw < 0.32:
            session.printer.reset(session.now)
        elif draw < 0.34:
            session.printer.hang(chance.choice((0.01, 3.0)), session.now)
        session.check_memory()
    session.check_reply()
    session.check_memory()
    session.printer.report()
    return session.executed


def main(arguments: list[str] | None = None) -> int:
    """Run all streams; return 1 if one failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--streams", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0, help="seed of the first stream")
    parser.add_argument("--firmware", choices=list(SIMULATED_FIRMWARES))
    chosen = parser.parse_args(arguments)
    names = [chosen.firmware] if chosen.firmware else list(SIMULATED_FIRMWARES)
    wrong: list[str] = []
    executed = Counter[str]()
    began = process_time()
    for n in range(chosen.streams):
        name = names[n % len(names)]
        try:
            executed[name] += stream(name, chosen.seed + n // len(names))
        except Outcome as outcome:
            wrong.append(str(outcome))
        except Exception as error:  # noqa: BLE001 - that is what is looked for
            wrong.append(
                f"firmware {name!r}, seed {chosen.seed + n // len(names)}: {type(error).__name__} {error}"
            )
    for line in wrong[:40]:
        print(line)
    done, seconds = sum(executed.values()), process_time() - began
    print(
        f"{chosen.streams} streams, {len(wrong)} of them failed, {done} commands executed, {seconds:.0f} s CPU"
    )
    for name, count in sorted(executed.items()):
        print(f"  {name:<20}{count:>9} commands")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
