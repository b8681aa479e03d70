"""Kill the printing host with SIGKILL at random times, resume the print, and compare what the printer executed.

    python benchmarks/killing.py --kills 200 --seed 1

The host is a separate process, and the simulated printer a pseudo-terminal. After each kill, the last command that the
journal lists as accepted is compared with the last command that the printer had started. At the end of each job, the
printer must have executed the commands of the file, once and in order.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random  # noqa: TID251 - seeded
from threading import Event as Flag
from threading import Thread
from time import monotonic

from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.printing.journal import read_journal
from printer_slicer.profile import load_profile
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.sim.simulated_firmware import SimulatedFirmware

PRINTER = load_profile("marlin_220").printer
OWN = ("M105", "M110", "M114", "M115", "M155", "M400")
ROOT = Path(__file__).parents[1]
_LAST_RESORT = 600.0  # s


@dataclass
class Outcome:
    """The result of one job.

    Attributes:
        kills: number of kills while lines were sent.
        ahead: for each kill, the number of commands that the printer had started and the journal does not list.
        exact: whether the commands of the file were executed once and in order.
        what: the fault, if there was one.
    """

    kills: int = 0
    ahead: list[int] = field(default_factory=list)
    exact: bool = False
    what: str = ""


@contextmanager
def served(
    link: Path,
    speed: float,
    firmware: SimulatedFirmware | None = None,
    executed: list[str] | None = None,
    ends: Callable[[], None] = lambda: None,
) -> Iterator[list[str]]:
    """Serve a simulated printer; `executed` collects its commands, and `ends` is called at its end."""
    ready, stop = Flag(), Flag()
    lines: list[str] = [] if executed is None else executed

    def make() -> SimulatedPrinter:
        return SimulatedPrinter(
            machine_of(PRINTER),
            firmware or simulated_firmware_for(PRINTER),
            on_executed=lines.append,
            boots=False,
        )

    thread = Thread(
        target=lambda: serve(make, link, speed=speed, stop=stop.is_set, ready=lambda _: ready.set())
    )
    thread.start()
    try:
        assert ready.wait(_LAST_RESORT)
        yield lines
    finally:
        stop.set()
        ends()
        thread.join(_LAST_RESORT)


def job_text(chance: Random, moves: int) -> str:
    """Return moves of all lengths, in which no two commands are equal."""
    lines = ["G28", "G90", "M83", "G92 E0", "M302 S0"]
    for number in range(moves):
        x, y = 10 + chance.random() * 180, 10 + chance.random() * 180
        lines.append(f"G1 X{x:.3f} Y{y:.3f} E0.{number % 9}1 F{chance.randrange(3000, 9000)}")
        if number % 50 == 0:
            lines.append(f"M117 line {number}")
    return "\n".join(lines) + "\n"


def of_job(executed: list[str]) -> list[str]:
    """Return the commands of the job, without those that hosts send on their own."""
    return [line for line in executed if not line.startswith(OWN)]


def start(folder: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a host process."""
    env = {**os.environ, "PRINTER_SLICER_STATE": str(folder / "state"), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "printer_slicer", *arguments]
    with (folder / "said").open("ab") as said:
        return subprocess.Popen(
            command, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=said, stderr=said
        )


def one_job(seed: int, kills: int, folder: Path) -> Outcome:
    """Print one job with some kills."""
    chance, outcome, never = Random(seed), Outcome(), Flag()
    text = job_text(chance, 50 * kills)
    wanted = text.split("\n")[:-1]
    (folder / "job.gcode").write_text(text, encoding="utf-8")
    speed = chance.choice([20.0, 50.0, 200.0])
    with served(folder / "port", speed) as executed:
        left = [folder]
        first: tuple[str, ...] = ("print", "job.gcode", "--port", "port", "--printer", "marlin_220")
        first += ("--reconnect", "0", "--allow", "cold", "--allow", "flow", "--allow", "feed")
        arguments = first
        while True:
            begun, before = monotonic(), len(executed)
            host = start(folder, *arguments)
            arguments = ("resume", "--reconnect", "0")
            while host.poll() is None and len(executed) == before and monotonic() - begun < _LAST_RESORT:
                never.wait(0.002)
            if outcome.kills < kills:
                # The kill can hit the handshake, lines in flight or a full planner: all happen within this time.
                never.wait(chance.choice([0.02, 0.3, 1.5]) * chance.random())
            if outcome.kills >= kills or host.poll() is not None:
                break
            host.kill()
            host.wait()
            left = list((folder / "state" / "prints").glob("*"))
            if not left and not executed:
                arguments, left = first, [folder]  # a slow machine: the print had not started yet
                continue
            if not left:
                break  # the print was done, and the process was exiting
            outcome.kills += 1
            story = read_journal(left[0])
            outcome.ahead.append(len(of_job(executed)) - story.entries)
        code = host.wait(timeout=_LAST_RESORT) if left else 0
        outcome.exact = of_job(executed) == wanted and code == 0
    if not outcome.exact:
        outcome.what = _first_difference(of_job(executed), wanted) + f"; exit code {code}"
        outcome.what += "\n" + (folder / "said").read_text(encoding="utf-8", errors="replace")[-600:]
    return outcome


def _first_difference(executed: list[str], wanted: list[str]) -> str:
    for number, (one, other) in enumerate(zip(executed, wanted, strict=False)):
        if one != other:
            return f"command {number} is {one!r}, but should be {other!r}"
    return f"{len(executed)} of {len(wanted)} commands"


def main() -> int:
    """Print how many kills were survived."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--per-job", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    made, good, ahead, seed = 0, 0, [], arguments.seed
    while made < arguments.kills:
        with tempfile.TemporaryDirectory() as folder:
            outcome = one_job(seed, arguments.per_job, Path(folder))
        made += outcome.kills
        good += outcome.kills if outcome.exact else 0
        ahead += outcome.ahead
        print(f"seed {seed}: {outcome.kills} kills, {'exact' if outcome.exact else outcome.what}", flush=True)
        seed += 1
    print(f"{good} of {made} kills: executed = file, once and in order")
    print(f"started commands that the journal does not list: {min(ahead)} to {max(ahead)}")
    return 0 if good == made else 1


if __name__ == "__main__":
    sys.exit(main())
