"""Who holds a print: one process at a time, and no longer than it lives."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

from printer_slicer.printing.host_settings import make_host_settings
from printer_slicer.printing.job_store import PortAddress, Print, create_print, load_print
from printer_slicer.profile import load_profile
from tests.waiting import LAST_RESORT

HOLD = (
    "import sys\nfrom pathlib import Path\nfrom printer_slicer.printing.job_store import load_print\n"
    "held = load_print(Path(sys.argv[1]))\nassert held.lock()\nprint('held', flush=True)\nsys.stdin.read()"
)


def begun(folder: Path) -> Print:
    return create_print(
        folder, "job.gcode", b"G28\n", PortAddress("/dev/null", 115200), make_host_settings(load_profile())
    )


def seen(folder: Path) -> Print:
    """The print as another program finds it."""
    found = load_print(folder)
    assert found
    return found


@contextmanager
def held_elsewhere(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The print is held by another process."""
    command = [sys.executable, "-c", HOLD, str(folder)]
    root = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=root
    ) as other:
        assert other.stdout
        assert other.stdout.readline() == "held\n"
        try:
            yield other
        finally:
            other.kill()
            other.wait(LAST_RESORT)


def test_a_print_that_another_process_holds_is_running(tmp_path: Path) -> None:
    print_ = begun(tmp_path)
    print_.release()

    with held_elsewhere(print_.folder):
        assert seen(print_.folder).is_locked
        assert not print_.lock()


def test_a_process_that_was_killed_holds_nothing(tmp_path: Path) -> None:
    print_ = begun(tmp_path)
    print_.release()
    with held_elsewhere(print_.folder):
        assert print_.is_locked

    assert not print_.is_locked
    assert print_.lock()


def test_looking_whether_a_print_runs_does_not_take_it(tmp_path: Path) -> None:
    print_ = begun(tmp_path)

    assert print_.is_locked
    assert seen(print_.folder).is_locked
    print_.release()
    assert not seen(print_.folder).is_locked
    assert seen(print_.folder).lock()


def test_another_thread_may_release_a_print(tmp_path: Path) -> None:
    print_ = begun(tmp_path)
    thread = Thread(target=print_.release)
    thread.start()
    thread.join()

    assert not seen(print_.folder).is_locked
