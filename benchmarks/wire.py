"""Measure how fast lines go to the printer, with host and simulated printer in one process on a simulated clock.

    python benchmarks/wire.py [MODEL] [--lines N] [--rounds N]

There are three results: the CPU time per line on a cable without delay; the lines per second of a real cable in
simulated time, with one line in flight and with two; and the CPU time of a dry run of a whole job.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from statistics import median
from time import process_time

from processes import SAMPLES, machine_note, spread
from wire_lab import QUICK

from printer_slicer import Job, dry_run, job_from, load_profile
from printer_slicer.sim.firmwares import MARLIN_2_0_AVR, MARLIN_2_1, SimulatedFirmware
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

BAUD, LATENCY = 115_200, 0.001
"""The real cable: baud rate, and additional delay of each byte in each direction, s."""

_RADIUS, _CHORD = 20.0, 0.05  # mm


@dataclass(frozen=True, slots=True)
class Streamed:
    """One job over the simulated cable: CPU seconds of both ends together, and simulated seconds."""

    cpu: float
    seconds: float


def main(argv: Sequence[str] | None = None) -> int:
    """Print the three results; return 1 if the dry run found a fault."""
    options = _options(argv)
    short, long = _circle(options.lines), _circle(2 * options.lines)
    print(machine_note())
    size = sum(len(command) for command in long[1:]) / (len(long) - 1)
    print(f"lines such as {long[-1].decode()}, {size:.1f} bytes on average without number and checksum")
    clean = [
        _stream_job(long, MARLIN_2_1, baud=None, latency=0.0, window=2) for _ in range(options.rounds + 1)
    ][1:]
    rates = [len(long) / streamed.cpu for streamed in clean]
    print(
        f"cable without errors and delay: {spread(rates, ',.0f')} lines per second of CPU time, both ends together"
    )
    for firmware in (MARLIN_2_1, MARLIN_2_0_AVR):
        for window in (1, 2):
            print(_print_wire_rate(short, long, firmware, window))
    job = job_from(options.model, load_profile(None, None, "standard"))
    return _print_dry_run(job, options.rounds)


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description="Measure lines per second of the protocol, and CPU time of a dry run."
    )
    parser.add_argument(
        "model", nargs="?", type=Path, default=SAMPLES / "vase.stl", help="default: the sample vase"
    )
    parser.add_argument(
        "--lines", type=int, default=10_000, help="number of lines of the shorter job (default 10000)"
    )
    parser.add_argument("--rounds", type=int, default=3, help="measured runs (default 3)")
    return parser.parse_args(argv)


def _circle(lines: int) -> list[bytes]:
    """Return short moves around a circle, repeated, as a slicer writes them."""
    commands = [b"M83", b"G1 X120 Y100 F6000"]
    for i in range(1, lines + 1):
        angle = i * _CHORD / _RADIUS % (2 * pi)
        x, y = 100 + _RADIUS * cos(angle), 100 + _RADIUS * sin(angle)
        commands.append(b"G1 X%.3f Y%.3f E%.5f" % (x, y, 0.033 * _CHORD))
    return commands


def _stream_job(
    commands: list[bytes], firmware: SimulatedFirmware, *, baud: int | None, latency: float, window: int
) -> Streamed:
    """Stream a job; raise an error unless every line was executed once and in order."""
    executed: list[str] = []
    machine = Machine(limits=QUICK.limits, coldest_extrusion=0.0)
    printer = SimulatedPrinter(machine, firmware, on_executed=executed.append)
    port = VirtualPort(printer, baud=baud, latency=latency)
    begun = process_time()
    run(Streamer(commands, limits=QUICK.limits, window_lines=window), port, port.now)
    cpu = process_time() - begun
    if [text for text in executed if text.startswith("G1")] != [line.decode() for line in commands[1:]]:
        sys.exit("the lines were not executed once and in order")
    return Streamed(cpu, port.now())


def _print_wire_rate(short: list[bytes], long: list[bytes], firmware: SimulatedFirmware, window: int) -> str:
    """Print lines per simulated second, from the difference of two jobs, so that handshake and end do not count."""
    one, two = (
        _stream_job(commands, firmware, baud=BAUD, latency=LATENCY, window=window)
        for commands in (short, long)
    )
    rate = (len(long) - len(short)) / (two.seconds - one.seconds)
    name = "Marlin 2.0, 8 bits" if firmware is MARLIN_2_0_AVR else "Marlin 2.1"
    return (
        f"{BAUD} baud, {LATENCY * 1000:g} ms, {name}, window {window}: {rate:.0f} lines per simulated second"
    )


def _print_dry_run(job: Job, rounds: int) -> int:
    """Print the CPU time of dry-running a job; return 1 if it would not print as intended."""
    profile = load_profile(None, None, "standard")
    times = []
    for _ in range(rounds + 1):
        begun = process_time()
        verdict = dry_run(job, profile)
        times.append(process_time() - begun)
    times = times[1:]
    lines, judgement = len(job.commands), "ok" if verdict.ok else "; ".join(verdict.problems)
    print(
        f"dry run of {job.name}: {lines} lines, {verdict.total_seconds:.0f} s simulated in {spread(times, '.2f')} s"
        f" of CPU, {lines / median(times):,.0f} lines/s: {judgement}"
    )
    return int(not verdict.ok)


if __name__ == "__main__":
    sys.exit(main())
