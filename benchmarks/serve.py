"""Kill the server again and again while it prints a queue, and count prints that are not exact.

    python -m benchmarks.serve [--kills 200] [--jobs N]

Two simulated printers print short jobs. The server starts the jobs; it is killed with SIGKILL at a random instant and
started again. This program is the person who clears the beds. At the end every job must be done exactly once, and the
simulated printer must have executed all its commands in order.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from threading import Event
from time import monotonic

import numpy as np

import printer_slicer as ps
from printer_slicer.print_queue import JobRequest, PrintQueue, read_file_facts
from tests.parts import box

PRINTERS = "".join(
    f'[{name}]\nport = "sim:"\nprofile = "marlin_220"\nspeed = 0\n' for name in ("left", "right")
)


def make_queue(folder: Path) -> tuple[PrintQueue, str]:
    """Return a queue in a folder, and the id of a short job in its store."""
    (folder / "printers.toml").write_text(PRINTERS)
    queue = PrintQueue(folder / "queue", folder / "printers.toml")
    job = ps.job_of(box((12, 12, 3)), ps.load_profile("marlin_220"))
    file = queue.add_file("box.gcode", [bytes(job.text)])
    queue.store_facts(file.id, read_file_facts(queue.files.find_path(file.id), file.name))
    return queue, file.id


def start_server(folder: Path) -> subprocess.Popen[bytes]:
    """Start the server on the queue in a folder."""
    command = [sys.executable, "-m", "printer_slicer", "serve", "--listen", "127.0.0.1:5077"]
    environment = os.environ | {"PRINTER_SLICER_STATE": str(folder)}
    words = ["--printers-file", str(folder / "printers.toml")]
    return subprocess.Popen([*command, *words], env=environment, stdout=subprocess.DEVNULL)


def clear_beds(queue: PrintQueue) -> None:
    """Do what a person does: declare the bed of each printer clear that prints nothing."""
    for printer in queue.snapshot().printers:
        if printer.job is None and printer.bed != "clear":
            queue.set_bed(printer.name, "clear")


def main() -> None:
    """Kill the server, and print how the jobs ended."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    random, pause = np.random.default_rng(arguments.seed), Event()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        queue, file = make_queue(folder)
        kills, n_jobs = 0, 0
        while kills < arguments.kills:
            while len(queue.snapshot().jobs) < 4:
                n_jobs += len(queue.add_jobs(file, JobRequest(copies=2)))
            server = start_server(folder)
            end = monotonic() + float(random.uniform(0.2, 6.0))
            while monotonic() < end:
                clear_beds(queue)
                pause.wait(0.1)
            server.send_signal(signal.SIGKILL)
            server.wait()
            kills += 1
        server = start_server(folder)
        while queue.snapshot().jobs:
            clear_beds(queue)
            pause.wait(0.2)
        server.terminate()
        server.wait()
        report(queue, kills, n_jobs)


def report(queue: PrintQueue, kills: int, n_jobs: int) -> None:
    """Print how the jobs and their runs ended."""
    outcomes, digests = Counter[str](), Counter[tuple[int, int, str]]()
    not_once = 0
    for job in range(1, n_jobs + 1):
        runs = queue.list_runs(job)
        outcomes.update(run.outcome or "unknown" for run in runs)
        done = [run for run in runs if run.outcome == "done"]
        not_once += len(done) != 1
        for run in done:
            facts = json.loads((queue.find_run_folder(run.id) / "simulation.json").read_text())
            digests[facts["executed"], facts["unexpected"], str(facts["digest"])] += 1
    print(f"{kills} kills, {n_jobs} jobs; runs: {dict(outcomes)}; jobs not done exactly once: {not_once}")
    for (executed, unexpected, digest), count in digests.items():
        print(f"{count} prints executed {executed} commands, {unexpected} unexpected, digest {digest[:12]}")


if __name__ == "__main__":
    main()
