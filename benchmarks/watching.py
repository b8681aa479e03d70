"""Print with and without a busy server, in pairs, and compare the rate of lines and the buffer underruns.

    python -m benchmarks.watching [--pairs 5] [--lines 2000]

The simulated printer is a process on a pseudo-terminal with the pace of a cable at 115200 baud. Without a server,
`queue run` starts the print. With one, `serve` starts it, ten browsers watch it, one client uploads files of 100 MB
and one slices models all the time. Two jobs are printed each time: one that only the cable limits, which gives the
rate, and one of short moves at 45 mm/s, in which each standstill is a buffer underrun.
"""

from __future__ import annotations

import argparse
import asyncio
import http.client
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from statistics import median
from threading import Event, Thread
from typing import Any, NamedTuple

import websockets
from websockets.asyncio.client import connect

from benchmarks.faulty_printer import PREPARED
from benchmarks.hosts import ROOT, circle
from benchmarks.processes import machine_note
from printer_slicer.mesh_io import export_stl
from printer_slicer.print_queue import JobRequest, PrintQueue, read_file_facts
from printer_slicer.server.access import SCOPES, AccessStore
from tests.parts import sphere

PORT = 5079
N_BROWSERS = 10
PROFILE = """
inherits = "marlin_220"
acceleration = 3000.0
max_acceleration_x = 3000.0
max_acceleration_y = 3000.0
"""


class Result(NamedTuple):
    """What the simulated printer tells of the two jobs.

    Attributes:
        rate: lines per second of the job that the cable limits.
        underruns: buffer underruns of the other one.
        messages: that the browsers got in both.
    """

    rate: float
    underruns: int
    messages: int


def main() -> None:
    """Print the pairs, and a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--lines", type=int, default=2000)
    arguments = parser.parse_args()
    print(machine_note())
    ratios = []
    for nth in range(arguments.pairs):
        order = (False, True) if nth % 2 else (True, False)
        results = {is_served: print_both_jobs(arguments.lines, is_served=is_served) for is_served in order}
        ratios.append(results[True].rate / results[False].rate)
        for is_served, result in sorted(results.items()):
            name = "busy server" if is_served else "no server"
            words = f"{result.rate:.1f} lines/s, {result.underruns} underruns, {result.messages} messages"
            print(f"{name:12} {words}", flush=True)
    shown = " ".join(f"{ratio:.1%}" for ratio in ratios)
    print(f"rate with the server / without: median {median(ratios):.1%} of {shown}")


def print_both_jobs(lines: int, *, is_served: bool) -> Result:
    """Print both jobs on a new queue."""
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(Path(name), is_served=is_served)
        fast = bench.print_job(circle(lines).replace("F3600", "F60000"), "quick")
        short = bench.print_job(circle(lines).replace("F3600", "F2700"), "part")
        for seen in (fast, short):
            assert seen["in_order"] == seen["commands"], seen
        return Result(
            (fast["in_order"] - PREPARED - 1) / fast["seconds"], short["underruns"], bench.n_messages
        )


class Bench:
    """A queue with one printer at the end of a cable.

    Args:
        folder: an empty folder.
        is_served: whether a busy server starts the prints.
    """

    def __init__(self, folder: Path, *, is_served: bool) -> None:
        self._folder, self._is_served, self.n_messages = folder, is_served, 0
        self._link, self._printers = folder / "printer", folder / "printers.toml"
        (folder / "fast.toml").write_text(PROFILE)
        self._printers.write_text(f'[left]\nport = "{self._link}"\nprofile = "{folder / "fast.toml"}"\n')
        export_stl(sphere(15.0), folder / "sphere.stl")

    def print_job(self, text: str, machine: str) -> dict[str, Any]:
        """Print a job; return what the printer tells."""
        job, report = self._folder / "job.gcode", self._folder / "report.json"
        job.write_text(text)
        words = [str(self._link), str(job), str(report), "--machine", machine]
        with (
            subprocess.Popen(
                [sys.executable, "-m", "benchmarks.faulty_printer", *words], stdout=subprocess.PIPE, cwd=ROOT
            ) as printer,
        ):
            assert printer.stdout is not None
            printer.stdout.readline()  # the printer is ready
            with suppress(OSError):  # a real printer has a processor of its own
                os.setpriority(os.PRIO_PROCESS, printer.pid, -20)
            try:
                self._run_queue(text)
            finally:
                printer.terminate()
        seen: dict[str, Any] = json.loads(report.read_text())
        return seen

    def _run_queue(self, text: str) -> None:
        """Print a job from the queue, and wait for its end."""
        queue = PrintQueue(self._folder / "queue", self._printers)
        access = AccessStore(queue.folder / "access.db")
        _, key = access.create_key("benchmark", SCOPES)
        access.close()
        file = queue.add_file("job.gcode", [text.encode()])
        queue.store_facts(file.id, read_file_facts(queue.files.find_path(file.id), file.name))
        with ExitStack() as stack:
            stack.callback(queue.close)
            stack.enter_context(self._run_supervisor())
            if self._is_served:
                stack.enter_context(self._keep_busy(key))
            queue.set_bed("left", "clear")
            (job,) = queue.add_jobs(file.id, JobRequest(allow=("feed", "cold", "flow")))
            while queue.find_job(job.id).state in {"ready", "starting", "printing"}:
                Event().wait(0.2)
            ended = queue.find_job(job.id)
            if ended.state != "done":
                print(f"the print is {ended.state}: {ended.message}", flush=True)

    @contextmanager
    def _run_supervisor(self) -> Iterator[None]:
        """Run what starts the print: the server, or `queue run`."""
        words = ["serve", "--listen", f"127.0.0.1:{PORT}"] if self._is_served else ["queue", "run"]
        command = [sys.executable, "-m", "printer_slicer", *words, "--printers-file", str(self._printers)]
        environment = os.environ | {"PRINTER_SLICER_STATE": str(self._folder)}
        with subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, cwd=ROOT) as process:
            try:
                yield
            finally:
                process.terminate()

    @contextmanager
    def _keep_busy(self, key: str) -> Iterator[None]:
        """Watch, upload and slice within a `with` block."""
        stop = Event()
        works = (self._watch, self._upload, self._slice)
        threads = [Thread(target=work, args=(key, stop)) for work in works]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            stop.set()
            for thread in threads:
                thread.join()

    def _watch(self, key: str, stop: Event) -> None:
        """Be ten browsers."""

        async def watch() -> None:
            while not stop.is_set():
                with suppress(OSError, websockets.WebSocketException):
                    address = f"ws://127.0.0.1:{PORT}/v1/feed"
                    async with connect(address, additional_headers={"X-Api-Key": key}) as browser:
                        while not stop.is_set():
                            with suppress(TimeoutError):
                                await asyncio.wait_for(browser.recv(), 0.5)
                                self.n_messages += 1
                await asyncio.sleep(0.2)

        async def watch_often() -> None:
            await asyncio.gather(*(watch() for _ in range(N_BROWSERS)))

        asyncio.run(watch_often())

    def _upload(self, key: str, stop: Event) -> None:
        """Upload files of 100 MB, one after the other."""
        head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="big.gcode"\r\n\r\n; %d\n'
        piece, n_pieces = b"G1 X10.000 Y20.000 E0.01234 F1200\n" * 2048, 1500
        while not stop.is_set():
            begin, end = head % self.n_messages, b"\r\n--x--\r\n"
            with suppress(OSError, http.client.HTTPException):
                connection = http.client.HTTPConnection("127.0.0.1", PORT)
                connection.putrequest("POST", "/v1/files")
                connection.putheader("X-Api-Key", key)
                connection.putheader("Content-Type", "multipart/form-data; boundary=x")
                connection.putheader("Content-Length", str(len(begin) + len(piece) * n_pieces + len(end)))
                connection.endheaders(begin)
                for _ in range(n_pieces):
                    if stop.is_set():
                        break
                    connection.send(piece)
                else:
                    connection.send(end)
                    connection.sock.settimeout(2.0)
                    connection.getresponse().read()
                connection.close()
            stop.wait(0.2)

    def _slice(self, key: str, stop: Event) -> None:
        """Slice a model again and again."""
        model = (self._folder / "sphere.stl").read_bytes()
        part = b'--x\r\nContent-Disposition: form-data; name="%s"%s\r\n\r\n%s\r\n'
        body = part % (b"printer", b"", b"left") + part % (b"file", b'; filename="sphere.stl"', model)
        while not stop.is_set():
            with suppress(OSError, http.client.HTTPException, ValueError, KeyError):
                task = self._request("POST", "/v1/slices", key, body + b"--x--\r\n")
                while task["state"] in {"waiting", "slicing"} and not stop.wait(0.3):
                    task = self._request("GET", f"/v1/slices/{task['id']}", key)
            stop.wait(0.2)

    def _request(self, method: str, path: str, key: str, body: bytes = b"") -> dict[str, Any]:
        """Return the JSON of an answer."""
        connection = http.client.HTTPConnection("127.0.0.1", PORT)
        headers = {"X-Api-Key": key, "Content-Type": "multipart/form-data; boundary=x"}
        connection.request(method, path, body, headers)
        answer: dict[str, Any] = json.loads(connection.getresponse().read())
        connection.close()
        return answer


if __name__ == "__main__":
    main()
