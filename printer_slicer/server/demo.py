"""A queue with two simulated printers and some jobs, to try the server with nothing connected."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory, gettempdir
from threading import Event
from time import monotonic
from typing import Final

import numpy as np

from printer_slicer.model import Mesh
from printer_slicer.print_queue import JobRequest, PrintQueue, Supervisor, read_file_facts
from printer_slicer.print_queue.run_folder import read_report
from printer_slicer.print_queue.supervisor import lock_queue
from printer_slicer.process_lock import ProcessLock
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_of

__all__ = ["end_demo_prints", "open_demo_folder", "open_demo_queue"]

_PRINTERS: Final = """\
[left]
port = "sim:"
profile = "marlin_220"
speed = 20

[right]
port = "sim:"
profile = "marlin_220"
material = "petg"
speed = 20
"""
_PREFIX: Final = "printer-slicer-demo-"  # of the names of the temporary folders
_LOCK_FILE: Final = "demo.lock"  # locked while the demonstration runs
_ENDING: Final = 10.0  # s
_PAUSE: Final = 0.2  # s
_SIDES: Final = 60
_WAVES: Final = 6


@contextmanager
def open_demo_folder() -> Iterator[Path]:
    """Create a temporary folder for a `with` block; delete those that killed demonstrations have left."""
    _delete_old_folders()
    with TemporaryDirectory(prefix=_PREFIX, ignore_cleanup_errors=True) as name:
        lock = ProcessLock(Path(name) / _LOCK_FILE)
        lock.acquire(0.0)
        try:
            yield Path(name)
        finally:
            lock.release()


def _delete_old_folders() -> None:
    """Delete the folders of demonstrations that were killed, unless one of their prints still runs."""
    for folder in Path(gettempdir()).glob(f"{_PREFIX}*"):
        lock = folder / _LOCK_FILE
        if not lock.exists() or ProcessLock(lock).is_held():
            continue
        states = {read_report(run).state for run in folder.glob("queue/runs/*")}
        if not states & {"starting", "printing"}:
            rmtree(folder, ignore_errors=True)


def open_demo_queue(folder: Path) -> PrintQueue:
    """Return a queue in a folder: one job starts at once, one waits for a clear bed, and one for PETG."""
    printers_file = folder / "printers.toml"
    printers_file.write_text(_PRINTERS, encoding="utf-8")
    queue = PrintQueue(folder / "queue", printers_file)
    jobs = (("vase", 18.0, 45.0, "pla"), ("bowl", 22.0, 15.0, "pla"), ("cup", 14.0, 20.0, "petg"))
    for name, radius, height, material in jobs:
        text = job_of(_make_wavy_cup(name, radius, height), load_profile("marlin_220", material)).text
        file = queue.add_file(f"{name}.gcode", [bytes(text)])
        queue.store_facts(file.id, read_file_facts(queue.files.find_path(file.id), file.name))
        queue.add_jobs(file.id, JobRequest())
    queue.set_bed("left", "clear")
    return queue


def end_demo_prints(queue: PrintQueue) -> None:
    """Cancel all prints, and wait for their end, at most ten seconds."""
    with lock_queue(queue):
        supervisor, end, pause = Supervisor(queue), monotonic() + _ENDING, Event()
        for run in queue.list_active_runs():
            queue.cancel_job(run.job)
        while queue.list_active_runs() and monotonic() < end:
            supervisor.step()
            pause.wait(_PAUSE)


def _make_wavy_cup(name: str, radius: float, height: float) -> Mesh:
    """Return a solid that becomes wider upward, with waves around it; mm."""
    angle = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    z = np.linspace(0, height, 24)[:, None]
    r = radius * (0.7 + 0.3 * np.sin(1.5 * z / height)) * (1 + 0.06 * np.sin(_WAVES * angle + 2 * z / height))
    rings = np.stack([r * np.cos(angle), r * np.sin(angle), np.broadcast_to(z, r.shape)], axis=-1)
    after = np.roll(rings, -1, axis=1)
    sides = [
        np.stack([rings[:-1], after[:-1], after[1:]], axis=2),
        np.stack([rings[:-1], after[1:], rings[1:]], axis=2),
    ]
    ends = []
    for ring, following, top in ((rings[0], after[0], 0.0), (rings[-1], after[-1], height)):
        middle = np.broadcast_to([0.0, 0.0, top], ring.shape)
        corners = (ring, following, middle) if top else (following, ring, middle)
        ends.append(np.stack(corners, axis=1))
    triangles = np.concatenate([*(side.reshape(-1, 3, 3) for side in sides), *ends])
    return Mesh(triangles, name)
