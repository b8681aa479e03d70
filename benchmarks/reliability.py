"""The reliability matrix: every fault of the wire against every firmware, and what became of the print.

    python -m benchmarks.reliability [--seeds 200] [--lines 3000] [--row NAME] [--firmware NAME] [--each]

Each row is a fault. Its seeds go round the firmwares in turn (`--each`: so many for every firmware). A print is exact
when every line was executed once, in order; altered when damage passed the checksum, which is one exclusive or; stopped
when it ended with a reason before the end, and what had been executed until then was the beginning of the job. Anything
else is wrong, and makes the command fail.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from random import Random  # noqa: TID251 - seeded
from statistics import median
from time import process_time
from zlib import crc32

from benchmarks import wire_faults as faults
from benchmarks.wire_lab import QUICK, Setup, Trial, job_of, print_over, questions
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES, SimulatedFirmware
from printer_slicer.sim.link import Direction
from printer_slicer.stream.events import Event, Halted
from printer_slicer.stream.states import State

__all__ = ["ROWS", "Row", "main", "suits"]

Maker = Callable[[Random, Setup], Setup]


@dataclass(frozen=True, slots=True)
class Row:
    """One fault.

    Attributes:
        make: adds the fault to a plain print.
        may_stop: the reasons, as parts of their text, with which such a print may end early.
        check: what must hold besides; a complaint, or nothing.
        suits: for which firmwares the row makes sense.
    """

    make: Maker
    may_stop: tuple[str, ...] = ()
    check: Callable[[Trial], str] = lambda _: ""
    suits: Callable[[SimulatedFirmware], bool] = lambda _: True


def _cable(make: Callable[[Random], faults.Fault]) -> Maker:
    return lambda chance, setup: replace(setup, fault=make(chance))


def _ordered(firmware: SimulatedFirmware) -> bool:
    return firmware.accepted_lines == "next"


def _checked(firmware: SimulatedFirmware) -> bool:
    return firmware.accepted_lines != "any"


def _no_questions(trial: Trial) -> str:
    asked = questions(trial)
    return f"{asked} questions" if asked and not trial.setup.firmware.ok_when_read else ""


def _clean(trial: Trial) -> str:
    rate, firmware = trial.rate, trial.setup.firmware
    least = (
        0.0
        if not _ordered(firmware) or firmware.ok_when_read
        else 0.97
        if trial.setup.baud == 115_200
        else 0.9
    )
    long = len(trial.setup.job) >= 1000  # a short job has too few lines between beginning and end to tell
    return f"{rate:.1%} of the wire" if long and rate < least else _no_questions(trial)


def _once(trial: Trial, name: str) -> bool:
    """Whether this is the first time in this trial, at a random place of the job."""
    at = 40 + crc32(trial.setup.job[50]) % (len(trial.setup.job) // 2)
    if name in trial.moments or trial.streamer.acknowledged < at:
        return False
    trial.moments[name] = trial.port.now()
    trial.moments["executed"] = len(trial.executed)
    return True


def _happening(act: Callable[[Trial], None], name: str) -> Callable[[Trial, Event], None]:
    def on_event(trial: Trial, _: Event) -> None:
        if _once(trial, name):
            act(trial)

    return on_event


def _within(name: str, seconds: float, *, lines: int | None = None) -> Callable[[Trial], str]:
    """The print must stop so soon after what happened, with no more than so many lines begun since."""

    def check(trial: Trial) -> str:
        if name not in trial.moments:
            return "nothing happened"
        late, more = trial.port.now() - trial.moments[name], len(trial.executed) - trial.moments["executed"]
        if not isinstance(trial.end, Halted):
            return f"not stopped but {trial.end}"
        if late > seconds:
            return f"stopped after {late:.1f} s"
        moved = [line for line in trial.executed[int(trial.moments["executed"]) :] if line.startswith("G1")]
        # Without a sequence the line that was on its way is executed.
        most = inf if lines is None else lines + (not _ordered(trial.setup.firmware))
        return f"{len(moved)} moves of {more:.0f} lines after it" if len(moved) > most else ""

    return check


def _reset(heard: bool) -> Maker:
    def make(_: Random, setup: Setup) -> Setup:
        banner = setup.firmware.banner if heard else ()
        # A bootloader takes longer; without one the rest of a line that was on its way would be read as a line.
        booting = replace(setup.firmware, banner=banner, boot_seconds=0.1)
        act = _happening(lambda trial: trial.printer.reset(trial.port.now()), "reset")
        return replace(setup, firmware=booting, on_event=act)

    return make


def _injected(said: bytes, name: str, *, every: float = 0.0) -> Maker:
    """The printer says something at a random moment; again and again if `every` is not 0 s."""

    def make(_: Random, setup: Setup) -> Setup:
        def act(trial: Trial, _event: Event) -> None:
            now = trial.port.now()
            if _once(trial, name) or (every and name in trial.moments and now >= trial.moments["next"]):
                trial.moments["next"] = now + every
                trial.streamer.receive(said.replace(b"@", b"%d" % (trial.streamer.acknowledged + 2)), now)

        return replace(setup, on_event=act, longest_wait=every or setup.longest_wait)

    return make


def _silence(way: Direction) -> Maker:
    def make(_: Random, setup: Setup) -> Setup:
        cut: list[bool] = []
        fault = lambda data, direction: b"" if cut and direction == way else data  # noqa: E731
        return replace(setup, fault=fault, on_event=_happening(lambda _: cut.append(True), "cut"))

    return make


def _killed(trial: Trial) -> str:
    """The printer must be dead, with no more than one line begun besides those that it had already taken."""
    before = len(trial.executed)
    end = trial.port.now() + 1.0
    while trial.port.now() < end:
        trial.port.read(end - trial.port.now())
    begun = trial.executed[before:]
    moves = sum(line.startswith("G1") for line in begun)
    if not trial.printer.report().killed:
        return "the printer lives"
    return f"{moves} moves after the stop" if moves > 1 + trial.setup.firmware.queue_places else ""


def _emergency(_: Random, setup: Setup) -> Setup:
    return replace(setup, on_event=_happening(lambda trial: trial.streamer.emergency_stop(), "stop"))


def _user(_: Random, setup: Setup) -> Setup:
    """Commands of a person and questions for temperatures, ten a second."""

    def act(trial: Trial, _event: Event) -> None:
        now = trial.port.now()
        if trial.streamer.state is State.STREAMING and now >= trial.moments.get("next", 0.0):
            trial.moments["next"] = now + 0.1
            trial.streamer.inject(b"M105")

    return replace(setup, on_event=act, longest_wait=0.05)


def _pausing(chance: Random, setup: Setup) -> Setup:
    def act(trial: Trial, _: Event) -> None:
        if trial.streamer.state is State.PAUSED:
            trial.streamer.resume()
        elif chance.random() < 50 / len(setup.job):
            trial.streamer.pause()

    return replace(setup, on_event=act, longest_wait=0.05)


def _hiccups(chance: Random, setup: Setup) -> Setup:
    """A slow main loop, and a receive buffer of half the size that the host believes in."""

    def act(trial: Trial, _: Event) -> None:
        if chance.random() < 0.005:
            trial.printer.hang(0.05, trial.port.now())

    small = replace(setup.firmware, receive_buffer=63) if setup.firmware.receive_buffer else setup.firmware
    return replace(setup, firmware=small, on_event=act)


def _slow(*commands: bytes) -> Maker:
    """Something that takes its time in the middle of the job, on a cable that is slow to answer."""

    def make(chance: Random, setup: Setup) -> Setup:
        at = len(setup.job) // 2
        # Few lines around it: what takes time here is the printer.
        job = [*setup.job[:60], *commands, *setup.job[at : at + 60]]
        latency = chance.choice([0.001, 0.016, 0.2])
        busy = chance.choice([0.0, setup.firmware.busy_seconds])
        slow = replace(QUICK, probe_seconds=33.0, hotend=replace(QUICK.hotend, heat_capacity=200.0))
        firmware = replace(setup.firmware, busy_seconds=busy)
        return replace(setup, job=job, latency=latency, machine=slow, firmware=firmware)

    return make


def _everything(chance: Random, setup: Setup) -> Setup:
    """Damage in both directions and lost answers, on firmware that may say no ok behind a request."""
    both = faults.CableNoise(chance, flip=5e-5, drop=2e-5)
    lose = faults.lost_oks(chance)
    firmware = replace(
        setup.firmware, ok_after_resend=chance.random() < 0.5 and setup.firmware.ok_after_resend
    )
    return replace(setup, firmware=firmware, fault=lambda data, way: lose(both(data, way), way))


def _bare_requests(chance: Random, setup: Setup) -> Setup:
    fault = faults.flips(chance, "to printer", flip=3e-4)
    return replace(setup, firmware=replace(setup.firmware, ok_after_resend=False), fault=fault)


def _baud(baud: int) -> Maker:
    """A cable at this speed; a line and its ok are under way for a millisecond longer than their bytes take."""
    return lambda _, setup: replace(setup, baud=baud, told_baud=baud, latency=0.0005)


_UNKNOWN = ("nobody can know",)
_RESET = ("was reset", "printer stopped", "nobody can know")
_NO_WAY = (*_UNKNOWN, "does not accept")


def _flips(rate: float) -> Row:
    return Row(_cable(lambda c: faults.flips(c, "to printer", flip=rate)), _UNKNOWN, suits=_checked)


ROWS: dict[str, Row] = {
    "clean, 115200 Bd": Row(_baud(115_200), check=_clean),
    "clean, 250000 Bd": Row(_baud(250_000), check=_clean, suits=lambda f: f.seconds_per_byte == 0.0),
    "flips to printer 1e-6": _flips(1e-6),
    "flips to printer 1e-4": _flips(1e-4),
    "flips to printer 1e-3": _flips(1e-3),
    "bytes dropped 1e-4": Row(
        _cable(lambda c: faults.flips(c, "to printer", drop=1e-4)), _UNKNOWN, suits=_checked
    ),
    "newlines lost": Row(_cable(faults.lost_newlines), _NO_WAY, suits=_checked),
    "newlines inserted": Row(_cable(faults.inserted_newlines), _NO_WAY, suits=_ordered),
    "flips to host 3e-4": Row(_cable(lambda c: faults.flips(c, "to host", flip=3e-4)), _UNKNOWN),
    "garbage to host": Row(_cable(faults.garbage), _UNKNOWN),
    "10 kB of noise to host": Row(_cable(faults.noise_burst), _UNKNOWN),
    "oks lost": Row(_cable(faults.lost_oks), _UNKNOWN),
    "oks doubled": Row(_cable(faults.doubled_oks), _UNKNOWN, suits=_ordered),
    "oks in pieces": Row(_cable(faults.pieces), _UNKNOWN),
    "oks glued to text": Row(_cable(faults.glued_oks), _UNKNOWN),
    "requests without ok": Row(_bare_requests, suits=_ordered),
    "requests twice": Row(_cable(lambda c: faults.repeated_requests(c, 2)), suits=_ordered),
    "requests ten times": Row(_cable(lambda c: faults.repeated_requests(c, 10)), _NO_WAY, suits=_ordered),
    "request storm": Row(
        _injected(b"Resend: @\n", "storm", every=0.1), ("does not accept", "was reset"), suits=_ordered
    ),
    "request of an ancient line": Row(_injected(b"Resend: 3\nok\n", "request"), _RESET, suits=_ordered),
    "request of a future line": Row(_injected(b"Resend: 90000\nok\n", "request"), _RESET, suits=_ordered),
    "everything at once": Row(_everything, _NO_WAY, suits=_ordered),
    "hiccups, small buffer": Row(_hiccups, _NO_WAY, suits=_ordered),
    "busy for ten minutes": Row(_slow(b"G4 S600"), check=_no_questions),
    "probing for five minutes": Row(_slow(b"G29"), check=_no_questions),
    "heating for a quarter of an hour": Row(_slow(b"M109 S220"), check=_no_questions),
    "one move of ten minutes": Row(_slow(b"G1 X190 Y190 F12"), check=_no_questions),
    "reset, heard": Row(_reset(heard=True), _RESET, check=_within("reset", 1.0, lines=0)),
    "reset, not heard": Row(
        _reset(heard=False), _RESET, check=_within("reset", 5.0, lines=0), suits=_ordered
    ),
    "killed": Row(
        _injected(b"Error:Heating failed, system stopped! Heater_ID: E0\n", "kill"),
        ("printer stopped",),
        check=_within("kill", 0.2),
    ),
    "Klipper's error": Row(
        _injected(b"!! Move out of range\nok\n", "kill"), ("printer stopped",), check=_within("kill", 0.2)
    ),
    "silence of the host's end": Row(
        _silence("to printer"), ("stopped answering",), check=_within("cut", 45.0)
    ),
    "silence of the printer's end": Row(
        _silence("to host"), ("stopped answering",), check=_within("cut", 45.0)
    ),
    "emergency stop": Row(_emergency, ("emergency stop",), check=_killed),
    "user and temperatures at 10/s": Row(_user),
    "pause and resume, 50 times": Row(_pausing),
}
"""Every row of the matrix that concerns the protocol."""


def suits(row: str) -> list[str]:
    """Names of the firmwares for which a row makes sense."""
    return [name for name, firmware in SIMULATED_FIRMWARES.items() if ROWS[row].suits(firmware)]


def trial_of(row: str, firmware: str, seed: int, lines: int) -> tuple[Trial, str]:
    """One print and its verdict; what the row does not allow is wrong."""
    chance = Random(f"{row} {firmware} {seed}")
    plain = Setup(SIMULATED_FIRMWARES[firmware], job_of(chance, lines))
    trial = print_over(ROWS[row].make(chance, plain))
    verdict = trial.verdict()
    if verdict.startswith("stopped") and not any(part in verdict for part in ROWS[row].may_stop):
        verdict = f"WRONG: {verdict}"
    complaint = "" if verdict.startswith("WRONG") else ROWS[row].check(trial)
    return trial, f"WRONG: {complaint}" if complaint else verdict


def _counted(verdict: str) -> str:
    return verdict.partition(":")[0]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 1 if a print was wrong."""
    options = _options(argv)
    print(f"{options.seeds} seeds a row, jobs of {options.lines} lines")
    print(
        "| fault | firmwares | exact | altered | stopped | wrong | requests, questions | of the wire | CPU |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    wrong = 0
    for row in ROWS:
        if options.row in row:
            wrong += _print_row(row, options)
    return int(wrong > 0)


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Every fault of the wire against every firmware.")
    parser.add_argument("--seeds", type=int, default=200, help="prints of each row (default 200)")
    parser.add_argument("--lines", type=int, default=3000, help="of each job (default 3000)")
    parser.add_argument("--row", default="", help="only rows whose name holds this")
    parser.add_argument("--firmware", default="", help="only firmwares whose name holds this")
    parser.add_argument("--each", action="store_true", help="so many seeds for every firmware")
    return parser.parse_args(argv)


def _print_row(row: str, options: argparse.Namespace) -> int:
    """Run and print one row; how many prints were wrong."""
    names = [name for name in suits(row) if options.firmware in name]
    if not names:
        return 0
    seeds = options.seeds * (len(names) if options.each else 1)
    began, verdicts, asked, rates = process_time(), Counter[str](), 0, [0.0]
    for seed in range(seeds):
        name = names[seed % len(names)]
        trial, verdict = trial_of(row, name, seed, options.lines)
        asked += questions(trial)
        verdicts[_counted(verdict)] += 1
        # One line at a time by design where line numbers are not checked, see `doubt`.
        rates += [trial.rate] if _ordered(trial.setup.firmware) else []
        if verdict.startswith("WRONG"):
            print(f"{row}, {name}, seed {seed}: {verdict}", file=sys.stderr)
    counts = " | ".join(str(verdicts[kind]) for kind in ("exact", "altered", "stopped", "WRONG"))
    figures = f"{asked / seeds:.1f} | {median(rates[1:] or rates):.0%} | {process_time() - began:.0f} s"
    print(f"| {row} | {len(names)} | {counts} | {figures} |", flush=True)
    return verdicts["WRONG"]


if __name__ == "__main__":
    sys.exit(main())
