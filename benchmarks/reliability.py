"""The reliability matrix: print with every fault of the wire on every firmware, and judge each print.

    python -m benchmarks.reliability [--seeds 200] [--lines 3000] [--row NAME] [--firmware NAME] [--each]

Each row is a fault. Its seeds are divided among the firmwares in turn; with `--each`, every firmware gets all seeds. A
print is *exact* if every line was executed once and in order. It is *altered* if damage passed the checksum, which is
one exclusive or. It is *stopped* if it ended early with a reason, and the executed lines were the beginning of the job.
Any other result is wrong, and makes the command fail.
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
from benchmarks.wire_lab import QUICK, Setup, Trial, count_queries, job_of, print_over
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
        check: an additional check; returns a complaint or nothing.
        suits: whether the row applies to a firmware.
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
    asked = count_queries(trial)
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
    long = len(trial.setup.job) >= 1000  # a short job has too few lines between its start and end
    return f"{rate:.1%} of the wire" if long and rate < least else _no_questions(trial)


def _is_first_time(trial: Trial, name: str) -> bool:
    """Return whether this is the first time in this trial, at a random place of the job."""
    at = 40 + crc32(trial.setup.job[50]) % (len(trial.setup.job) // 2)
    if name in trial.moments or trial.streamer.acknowledged < at:
        return False
    trial.moments[name] = trial.port.now()
    trial.moments["executed"] = len(trial.executed)
    return True


def _act_once(act: Callable[[Trial], None], name: str) -> Callable[[Trial, Event], None]:
    def on_event(trial: Trial, _: Event) -> None:
        if _is_first_time(trial, name):
            act(trial)

    return on_event


def _stops_within(name: str, seconds: float, *, lines: int | None = None) -> Callable[[Trial], str]:
    """Require that the print stops soon after the event, with only a few lines started since."""

    def check(trial: Trial) -> str:
        if name not in trial.moments:
            return "nothing happened"
        late, more = trial.port.now() - trial.moments[name], len(trial.executed) - trial.moments["executed"]
        if not isinstance(trial.end, Halted):
            return f"not stopped but {trial.end}"
        if late > seconds:
            return f"stopped after {late:.1f} s"
        moved = [line for line in trial.executed[int(trial.moments["executed"]) :] if line.startswith("G1")]
        # Without line numbers, the line in flight is executed.
        most = inf if lines is None else lines + (not _ordered(trial.setup.firmware))
        return f"{len(moved)} moves of {more:.0f} lines after it" if len(moved) > most else ""

    return check


def _reset(heard: bool) -> Maker:
    def make(_: Random, setup: Setup) -> Setup:
        banner = setup.firmware.banner if heard else ()
        # A bootloader takes longer; without one, the rest of a line in flight would be read as a line.
        booting = replace(setup.firmware, banner=banner, boot_seconds=0.1)
        act = _act_once(lambda trial: trial.printer.reset(trial.port.now()), "reset")
        return replace(setup, firmware=booting, on_event=act)

    return make


def _inject_text(said: bytes, name: str, *, every: float = 0.0) -> Maker:
    """Let the printer send text at a random time, repeatedly if `every` is not 0 s."""

    def make(_: Random, setup: Setup) -> Setup:
        def act(trial: Trial, _event: Event) -> None:
            now = trial.port.now()
            if _is_first_time(trial, name) or (
                every and name in trial.moments and now >= trial.moments["next"]
            ):
                trial.moments["next"] = now + every
                trial.streamer.receive(said.replace(b"@", b"%d" % (trial.streamer.acknowledged + 2)), now)

        return replace(setup, on_event=act, longest_wait=every or setup.longest_wait)

    return make


def _silence(way: Direction) -> Maker:
    def make(_: Random, setup: Setup) -> Setup:
        cut: list[bool] = []
        fault = lambda data, direction: b"" if cut and direction == way else data  # noqa: E731
        return replace(setup, fault=fault, on_event=_act_once(lambda _: cut.append(True), "cut"))

    return make


def _check_killed(trial: Trial) -> str:
    """Require that the printer is dead, and has started at most one line besides those already received."""
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
    return replace(setup, on_event=_act_once(lambda trial: trial.streamer.emergency_stop(), "stop"))


def _add_user_commands(_: Random, setup: Setup) -> Setup:
    """Send user commands and temperature queries, ten per second."""

    def act(trial: Trial, _event: Event) -> None:
        now = trial.port.now()
        if trial.streamer.state is State.STREAMING and now >= trial.moments.get("next", 0.0):
            trial.moments["next"] = now + 0.1
            trial.streamer.inject(b"M105")

    return replace(setup, on_event=act, longest_wait=0.05)


def _pausing(chance: Random, setup: Setup) -> Setup:
    """Pause after an event now and then; resume when the host wakes next, or one of the next times."""

    def pause(trial: Trial, _: Event) -> None:
        if chance.random() < 50 / len(setup.job):
            trial.streamer.pause()

    # A paused host with nothing in flight may have no event that could resume the print.
    def resume(trial: Trial) -> None:
        if trial.streamer.state is State.PAUSED and chance.random() < 0.5:
            trial.streamer.resume()

    return replace(setup, on_event=pause, before_send=resume, longest_wait=0.05)


def _slow_main_loop(chance: Random, setup: Setup) -> Setup:
    """Slow down the main loop, and halve the receive buffer that the host assumes."""

    def act(trial: Trial, _: Event) -> None:
        if chance.random() < 0.005:
            trial.printer.hang(0.05, trial.port.now())

    small = replace(setup.firmware, receive_buffer=63) if setup.firmware.receive_buffer else setup.firmware
    return replace(setup, firmware=small, on_event=act)


def _slow(*commands: bytes) -> Maker:
    """Add a slow command in the middle of the job, on a cable with slow replies."""

    def make(chance: Random, setup: Setup) -> Setup:
        at = len(setup.job) // 2
        # The job is short, because the time is spent in the printer.
        job = [*setup.job[:60], *commands, *setup.job[at : at + 60]]
        latency = chance.choice([0.001, 0.016, 0.2])
        busy = chance.choice([0.0, setup.firmware.busy_seconds])
        slow = replace(QUICK, probe_seconds=33.0, hotend=replace(QUICK.hotend, heat_capacity=200.0))
        firmware = replace(setup.firmware, busy_seconds=busy)
        return replace(setup, job=job, latency=latency, machine=slow, firmware=firmware)

    return make


def _combine_faults(chance: Random, setup: Setup) -> Setup:
    """Combine damage in both directions and lost answers, on firmware that may omit the ok after a request."""
    both = faults.CableNoise(chance, flip=5e-5, drop=2e-5)
    lose = faults.lost_oks(chance)
    firmware = replace(
        setup.firmware, ok_after_resend=chance.random() < 0.5 and setup.firmware.ok_after_resend
    )
    return replace(setup, firmware=firmware, fault=lambda data, way: lose(both(data, way), way))


def _bare_requests(chance: Random, setup: Setup) -> Setup:
    fault = faults.flip_bytes(chance, "to printer", flip=3e-4)
    return replace(setup, firmware=replace(setup.firmware, ok_after_resend=False), fault=fault)


def _baud(baud: int) -> Maker:
    """Make a cable with this baud rate; a line and its ok take a millisecond longer than their bytes."""
    return lambda _, setup: replace(setup, baud=baud, assumed_baud=baud, latency=0.0005)


_UNKNOWN = ("nobody can know",)
_RESET = ("was reset", "printer stopped", "nobody can know")
_NO_WAY = (*_UNKNOWN, "does not accept")


def _flips(rate: float) -> Row:
    return Row(_cable(lambda c: faults.flip_bytes(c, "to printer", flip=rate)), _UNKNOWN, suits=_checked)


ROWS: dict[str, Row] = {
    "clean, 115200 baud": Row(_baud(115_200), check=_clean),
    "clean, 250000 baud": Row(_baud(250_000), check=_clean, suits=lambda f: f.seconds_per_byte == 0.0),
    "flips to printer 1e-6": _flips(1e-6),
    "flips to printer 1e-4": _flips(1e-4),
    "flips to printer 1e-3": _flips(1e-3),
    "bytes dropped 1e-4": Row(
        _cable(lambda c: faults.flip_bytes(c, "to printer", drop=1e-4)), _UNKNOWN, suits=_checked
    ),
    "newlines lost": Row(_cable(faults.lost_newlines), _NO_WAY, suits=_checked),
    "newlines inserted": Row(_cable(faults.inserted_newlines), _NO_WAY, suits=_ordered),
    "flips to host 3e-4": Row(_cable(lambda c: faults.flip_bytes(c, "to host", flip=3e-4)), _UNKNOWN),
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
        _inject_text(b"Resend: @\n", "storm", every=0.1), ("does not accept", "was reset"), suits=_ordered
    ),
    "request of an ancient line": Row(_inject_text(b"Resend: 3\nok\n", "request"), _RESET, suits=_ordered),
    "request of a future line": Row(_inject_text(b"Resend: 90000\nok\n", "request"), _RESET, suits=_ordered),
    "everything at once": Row(_combine_faults, _NO_WAY, suits=_ordered),
    "hiccups, small buffer": Row(_slow_main_loop, _NO_WAY, suits=_ordered),
    "busy for ten minutes": Row(_slow(b"G4 S600"), check=_no_questions),
    "probing for five minutes": Row(_slow(b"G29"), check=_no_questions),
    "heating for a quarter of an hour": Row(_slow(b"M109 S220"), check=_no_questions),
    "one move of ten minutes": Row(_slow(b"G1 X190 Y190 F12"), check=_no_questions),
    "reset, heard": Row(_reset(heard=True), _RESET, check=_stops_within("reset", 1.0, lines=0)),
    "reset, not heard": Row(
        _reset(heard=False), _RESET, check=_stops_within("reset", 5.0, lines=0), suits=_ordered
    ),
    "killed": Row(
        _inject_text(b"Error:Heating failed, system stopped! Heater_ID: E0\n", "kill"),
        ("printer stopped",),
        check=_stops_within("kill", 0.2),
    ),
    "Klipper's error": Row(
        _inject_text(b"!! Move out of range\nok\n", "kill"),
        ("printer stopped",),
        check=_stops_within("kill", 0.2),
    ),
    "silence of the host's end": Row(
        _silence("to printer"), ("stopped answering",), check=_stops_within("cut", 45.0)
    ),
    "silence of the printer's end": Row(
        _silence("to host"), ("stopped answering",), check=_stops_within("cut", 45.0)
    ),
    "emergency stop": Row(_emergency, ("emergency stop",), check=_check_killed),
    "user and temperatures at 10/s": Row(_add_user_commands),
    "pause and resume, 50 times": Row(_pausing),
}
"""All rows of the matrix."""


def suits(row: str) -> list[str]:
    """Return the names of the firmwares that a row applies to."""
    return [name for name, firmware in SIMULATED_FIRMWARES.items() if ROWS[row].suits(firmware)]


def trial_of(row: str, firmware: str, seed: int, lines: int) -> tuple[Trial, str]:
    """Run one print and judge it; a result that the row does not allow is wrong."""
    chance = Random(f"{row} {firmware} {seed}")
    plain = Setup(SIMULATED_FIRMWARES[firmware], job_of(chance, lines))
    trial = print_over(ROWS[row].make(chance, plain))
    verdict = trial.verdict()
    if verdict.startswith("stopped") and not any(part in verdict for part in ROWS[row].may_stop):
        verdict = f"WRONG: {verdict}"
    complaint = "" if verdict.startswith("WRONG") else ROWS[row].check(trial)
    return trial, f"WRONG: {complaint}" if complaint else verdict


def _count_verdict(verdict: str) -> str:
    return verdict.partition(":")[0]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a print was wrong."""
    options = _options(argv)
    print(f"{options.seeds} seeds a row, jobs of {options.lines} lines")
    print(
        "| fault | firmwares | exact | altered | stopped | wrong | requests, queries | share of the wire | CPU |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    wrong = 0
    for row in ROWS:
        if options.row in row:
            wrong += _print_row(row, options)
    return int(wrong > 0)


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Test every fault of the wire on every firmware.")
    parser.add_argument("--seeds", type=int, default=200, help="number of prints for each row (default 200)")
    parser.add_argument("--lines", type=int, default=3000, help="number of lines of each job (default 3000)")
    parser.add_argument("--row", default="", help="only rows whose name contains this")
    parser.add_argument("--firmware", default="", help="only firmwares whose name contains this")
    parser.add_argument("--each", action="store_true", help="run all seeds with every firmware")
    return parser.parse_args(argv)


def _print_row(row: str, options: argparse.Namespace) -> int:
    """Run and print one row; return the number of wrong prints."""
    names = [name for name in suits(row) if options.firmware in name]
    if not names:
        return 0
    seeds = options.seeds * (len(names) if options.each else 1)
    began, verdicts, asked, rates = process_time(), Counter[str](), 0, [0.0]
    for seed in range(seeds):
        name = names[seed % len(names)]
        trial, verdict = trial_of(row, name, seed, options.lines)
        asked += count_queries(trial)
        verdicts[_count_verdict(verdict)] += 1
        # Where line numbers are not checked, only one line is in flight by design, see `unacked_line`.
        rates += [trial.rate] if _ordered(trial.setup.firmware) else []
        if verdict.startswith("WRONG"):
            print(f"{row}, {name}, seed {seed}: {verdict}", file=sys.stderr)
    counts = " | ".join(str(verdicts[kind]) for kind in ("exact", "altered", "stopped", "WRONG"))
    figures = f"{asked / seeds:.1f} | {median(rates[1:] or rates):.0%} | {process_time() - began:.0f} s"
    print(f"| {row} | {len(names)} | {counts} | {figures} |", flush=True)
    return verdicts["WRONG"]


if __name__ == "__main__":
    sys.exit(main())
