"""The queue with real processes: the supervisor and prints are killed while simulated printers print."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from printer_slicer.print_queue import JobRequest, PrintQueue, read_file_facts
from printer_slicer.print_queue.supervisor import lock_queue
from printer_slicer.printing.control_socket import send_control_command
from printer_slicer.printing.job_store import default_job_store
from tests.cli.command_line import USUAL, typed
from tests.waiting import LAST_RESORT, hosts, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

PRINTERS = """
[left]
port = "sim:"
profile = "marlin_220"
speed = 30
guard = 0
[right]
port = "/dev/there-is-no-such-port"
profile = "marlin_220"
"""
MOVES = 600
GCODE = "G28\nG90\nM83\nG1 Z0.2 F600\n" + "".join(
    f"G1 X{10 + i % 60} Y{10 + i % 7} E0.01 F6000\n" for i in range(MOVES)
)


class Farm:
    """A queue with a file, and the programs that run it."""

    def __init__(self, folder: Path, started: list[subprocess.Popen[bytes]]) -> None:
        self.queue = PrintQueue(folder / "state" / "queue", folder / "printers.toml")
        self._folder, self._started = folder, started
        (folder / "part.gcode").write_text(GCODE, encoding="utf-8")
        self._file = self.queue.add_file("part.gcode", [GCODE.encode()]).id
        self.queue.store_facts(self._file, read_file_facts(folder / "part.gcode", "part.gcode"))

    def add(self, printer: str) -> int:
        request = JobRequest(printer=printer, allow=("cold",))
        return self.queue.add_jobs(self._file, request)[0].id

    def supervise(self) -> subprocess.Popen[bytes]:
        words = [sys.executable, "-m", "printer_slicer", "queue", "run"]
        process = subprocess.Popen(
            words, cwd=self._folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=os.environ | USUAL
        )
        self._started.append(process)
        return process

    def wait_for(self, job: int, *states: str) -> None:
        until(lambda: self.queue.find_job(job).state in {*states, "done", "failed", "cancelled"})
        assert self.queue.find_job(job).state in states, self.queue.find_job(job)

    def wait_until_it_prints(self, job: int) -> Path:
        """Return the folder of the print in the job store."""
        self.wait_for(job, "printing")
        folder = default_job_store() / self.queue.find_job(job).run

        def has_begun() -> bool:
            status = json.loads(send_control_command(folder, "status")["answer"])
            return bool(status.get("done", 0) > 20)

        until(has_begun)
        return folder

    def read_simulation(self, job: int) -> dict[str, object]:
        folder = self.queue.find_run_folder(self.queue.find_job(job).run)
        return dict(json.loads((folder / "simulation.json").read_text(encoding="utf-8")))


@pytest.fixture
def farm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Farm]:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("PRINTER_SLICER_PRINTERS", str(tmp_path / "printers.toml"))
    (tmp_path / "printers.toml").write_text(PRINTERS, encoding="utf-8")
    (tmp_path / "state").mkdir()
    with hosts(tmp_path / "state") as started:
        made = Farm(tmp_path, started)
        yield made
        for process in started:
            if process.stdout is not None:
                process.kill()
                process.stdout.close()
        made.queue.close()


def test_a_print_survives_its_supervisor_and_the_next_one_records_its_end(farm: Farm) -> None:
    first, second = farm.add("left"), farm.add("left")
    farm.queue.set_bed("left", "clear")
    supervisor = farm.supervise()
    print_folder = farm.wait_until_it_prints(first)

    supervisor.kill()
    supervisor.wait(LAST_RESORT)
    assert print_folder.exists()
    farm.supervise()
    farm.wait_for(first, "done")

    done = farm.read_simulation(first)
    assert (done["executed"], done["unexpected"]) == (MOVES + 4, 0)
    assert len(farm.queue.list_runs(first)) == 1
    assert farm.queue.find_job(second).state == "ready"
    assert farm.queue.snapshot().printers[0].bed == "occupied"


def test_a_killed_print_fails_and_blocks_the_printer(farm: Farm) -> None:
    first, second = farm.add("left"), farm.add("left")
    farm.queue.set_bed("left", "clear")
    farm.supervise()
    farm.wait_until_it_prints(first)

    claim = farm.queue.find_run_folder(farm.queue.find_job(first).run) / "claim"
    os.kill(int(claim.read_text(encoding="utf-8")), signal.SIGKILL)
    farm.wait_for(first, "failed")

    assert farm.queue.list_runs(first)[0].outcome == "lost"
    state = farm.queue.snapshot().printers[0]
    assert (state.bed, state.message) == (
        "occupied",
        f"job {first}: the print process ended without a result",
    )
    assert farm.queue.find_job(second).state == "ready"


def test_a_printing_job_can_be_cancelled(farm: Farm) -> None:
    job = farm.add("left")
    farm.queue.set_bed("left", "clear")
    farm.supervise()
    farm.wait_until_it_prints(job)

    outcome = typed("queue", "cancel", job)
    farm.wait_for(job, "cancelled")

    assert outcome.code == 0, outcome.err
    assert farm.queue.snapshot().printers[0].bed == "occupied"


def test_a_job_whose_port_cannot_be_opened_waits_again(farm: Farm) -> None:
    job = farm.add("right")
    farm.queue.set_bed("right", "clear")
    farm.supervise()
    until(lambda: [run for run in farm.queue.list_runs(job) if run.outcome == "not_started"])

    found = farm.queue.find_job(job)
    assert (found.state, farm.queue.snapshot().printers[1].bed) == ("ready", "occupied")
    assert "there-is-no-such-port" in found.message


def test_findings_that_are_not_allowed_reject_a_job_before_anything_is_sent(farm: Farm) -> None:
    job = farm.queue.add_jobs(farm.queue.find_job(farm.add("right")).file, JobRequest(printer="left"))[0].id
    farm.queue.set_bed("left", "clear")
    farm.supervise()
    farm.wait_for(job, "failed")

    (run,) = farm.queue.list_runs(job)
    assert run.outcome == "rejected"
    assert run.findings == ("cold",)
    assert farm.queue.find_job(job).message.endswith("; nothing was sent")

    request = JobRequest(printer="left", allow=run.findings)
    (again,) = farm.queue.add_jobs(farm.queue.find_job(job).file, request)
    farm.queue.set_bed("left", "clear")
    farm.wait_for(again.id, "printing", "done")


def test_two_supervisors_at_once_refuse(farm: Farm) -> None:
    with lock_queue(farm.queue):
        outcome = typed("queue", "run")

    assert outcome.code == 2
    assert "another process runs the queue" in outcome.err
