"""Compare our host with OctoPrint and Printrun from the package index, on the same simulated printer over a pty.

    PRINTER_SLICER_HOSTS=hosts python -m benchmarks.hosts [--lines N] [--faults] [--rates] [--starving] [--only NAME]

docs/hosts.md explains how to make the environments. There are three tables: lines per second where only the cable
limits, standstills of a machine that prints chords of 0.2 mm at 60 mm/s, and the result of a print with a fault.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import select
import socket
import subprocess
import sys
import tempfile
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import cos, pi, sin
from pathlib import Path
from time import monotonic
from typing import Any, Final

from benchmarks.faulty_printer import FAULTS, MACHINES, PREPARED
from benchmarks.processes import machine_note
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

ROOT: Final = Path(__file__).parents[1]
BAUDS: Final = (115_200, 250_000)
LATENCIES: Final = (1.0, 16.0)  # round-trip time, ms
FAULT_SECONDS: Final = 90.0
_KEY: Final = "0123456789ABCDEF0123456789ABCDEF"
_CONFIG: Final = """\
server: {firstRun: false, onlineCheck: {enabled: false}, pluginBlacklist: {enabled: false}}
serial: {additionalPorts: [%s], autoconnect: false}
plugins:
  _disabled: [announcements, softwareupdate, discovery, pluginmanager, tracking, errortracking, virtual_printer, backup]
"""

Host = Callable[[Path, Path, float], str]
"""Prints a file to a port within a time limit, s, and returns how it ended, as text."""


def main(argv: Sequence[str] | None = None) -> int:
    """Print the requested tables; by default all."""
    options = _options(argv)
    print(machine_note())
    options.faults = options.faults or options.fault is not None
    every = not (options.rates or options.starving or options.faults)
    with tempfile.TemporaryDirectory() as name, _find_hosts(Path(name), options.only) as hosts:
        folder = Path(name)
        if options.rates or every:
            _print_protocol_rates(options.lines)
            _print_rates(hosts, folder, options.lines)
        if options.starving or every:
            _print_standstills(hosts, folder, options.lines)
        if options.faults or every:
            _print_faults(hosts, folder, options.fault or FAULTS)
    return 0


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Compare hosts on the same simulated printer.")
    parser.add_argument("--lines", type=int, default=2000, help="number of lines of the job (default 2000)")
    parser.add_argument("--rates", action="store_true")
    parser.add_argument("--starving", action="store_true")
    parser.add_argument("--faults", action="store_true")
    parser.add_argument("--fault", action="append", choices=FAULTS, help="only this fault; may be repeated")
    parser.add_argument("--only", help="only this host: ours, octoprint or printrun")
    return parser.parse_args(argv)


def circle(lines: int) -> str:
    """Return chords of 0.2 mm at 60 mm/s, 300 per second, as a slicer writes them."""
    commands = ["G28", "M83", "G1 X120 Y100 F6000", "G4 P0", "G1 F3600"]
    for i in range(1, lines + 1):
        angle = i * 0.2 / 20 % (2 * pi)
        commands.append(f"G1 X{100 + 20 * cos(angle):.3f} Y{100 + 20 * sin(angle):.3f} E0.00665")
    return "\n".join(commands) + "\n"


def _make_fast(lines: int) -> str:
    """Return the same moves at a speed at which only the cable limits."""
    return circle(lines).replace("F3600", "F60000")


# Hosts


@contextmanager
def _find_hosts(folder: Path, only: str | None) -> Iterator[dict[str, Host]]:
    """Return the installed hosts by name."""
    where = Path(os.environ.get("PRINTER_SLICER_HOSTS", "hosts"))
    link = folder / "printer"
    hosts: dict[str, Host] = {"ours": _print_with_ours}
    if (where / "printrun" / "bin" / "python").exists():
        hosts["printrun"] = lambda port, job, limit: _print_with_printrun(where, port, job, limit)
    octoprint = where / "octoprint" / "bin" / "octoprint"
    wanted = only in {None, "octoprint"} and octoprint.exists()
    if wanted:
        with _start_octoprint(octoprint, folder / "octoprint", link) as url:
            hosts["octoprint"] = lambda port, job, limit: _print_with_octoprint(url, port, job, limit)
            yield {name: host for name, host in hosts.items() if only in {None, name}}
    else:
        yield {name: host for name, host in hosts.items() if only in {None, name}}


def _print_with_ours(port: Path, job: Path, limit: float) -> str:
    """Print with our own command."""
    command = [sys.executable, "-m", "printer_slicer", "print", str(job), "--port", str(port), "--json"]
    limits = [
        f"--set=printer.{name}=3000" for name in ("acceleration", "max_acceleration_x", "max_acceleration_y")
    ]
    with tempfile.TemporaryDirectory() as work:
        return _run_process(
            [*command, "--allow", "feed", *limits],
            limit,
            env={"PYTHONPATH": str(ROOT), "HOME": work},
            cwd=Path(work),
        )


def _print_with_printrun(where: Path, port: Path, job: Path, limit: float) -> str:
    """Print with Printrun's printcore, run by its Python."""
    script = ROOT / "benchmarks" / "drive_printcore.py"
    command = [where / "printrun" / "bin" / "python", script, port, job, limit - 5]
    return _run_process(list(map(str, command)), limit)


def _run_process(
    command: list[str], limit: float, env: dict[str, str] | None = None, cwd: Path | None = None
) -> str:
    """Run a process and describe how it ended: its exit code and the last lines of its output."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            timeout=limit,
            check=False,
            env={**os.environ, **(env or {})},
            cwd=cwd,
        )
    except subprocess.TimeoutExpired:
        return "hangs"
    said = (done.stderr.decode(errors="replace") or done.stdout.decode(errors="replace")).strip()
    if done.returncode == 0:
        return "ended" if '"done": false' not in done.stdout.decode(errors="replace") else "hangs"
    return f"stopped ({done.returncode}): {said.splitlines()[0] if said else ''}"


@contextmanager
def _start_octoprint(binary: Path, folder: Path, link: Path) -> Iterator[str]:
    """Start an OctoPrint that knows our port, and return its address."""
    folder.mkdir()
    (folder / "config.yaml").write_text(_CONFIG % link)
    base = [str(binary), "--basedir", str(folder)]
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        number = listener.getsockname()[1]
    subprocess.run(
        [*base, "user", "add", "bench", "--password", "secret", "--admin"], check=True, capture_output=True
    )
    users = folder / "users.yaml"
    users.write_text(re.sub("apikey: .*", f"apikey: {_KEY}", users.read_text()))
    serve = [*base, "serve", "--host", "127.0.0.1", "--port", str(number), "--iknowwhatimdoing"]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(serve, stdout=log, stderr=subprocess.STDOUT)
        try:
            url = f"http://127.0.0.1:{number}"
            _wait_until(lambda: "api" in _request(url, "/api/version"), 120)
            yield url
        finally:
            process.terminate()
            process.wait(30)


def _request(url: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
    """Send a request to OctoPrint; return {} while it does not answer."""
    data = None if body is None else json.dumps(body).encode()
    headers = {"X-Api-Key": _KEY, "Content-Type": "application/json"}
    try:
        with urllib.request.urlopen(urllib.request.Request(url + path, data, headers), timeout=20) as answer:
            text = answer.read()
    except (OSError, ValueError):
        return {}
    except Exception:  # noqa: BLE001 - it says nonsense while it starts
        return {}
    return dict(json.loads(text)) if text.strip().startswith(b"{") else {"said": True}


def _wait_until(true: Callable[[], bool], seconds: float, pause: float = 0.2) -> bool:
    """Wait for a condition; return whether it became true."""
    end = monotonic() + seconds
    while monotonic() < end:
        if true():
            return True
        select.select([], [], [], pause)
    return False


def _print_with_octoprint(url: str, port: Path, job: Path, limit: float) -> str:
    """Print with OctoPrint, by requests to its API."""
    from printer_slicer.sending import Upload, send

    send(Upload(job, job.name), "octoprint", url, key=_KEY)

    def state() -> str:
        """Return the state that OctoPrint reports."""
        return str(_request(url, "/api/job").get("state", ""))

    connect = {"command": "connect", "port": str(port), "baudrate": 115200, "save": False}
    if not _request(url, "/api/connection", connect) or not _wait_until(lambda: state() == "Operational", 60):
        said = state()
        _request(url, "/api/connection", {"command": "disconnect"})
        return f"stopped: does not connect ({said})"
    _request(url, f"/api/files/local/{job.name}", {"command": "select", "print": True})
    _wait_until(lambda: state().startswith("Printing"), 15, 0.05)
    over = _wait_until(lambda: not state().startswith(("Printing", "Finishing", "Starting")), limit)
    job_state = _request(url, "/api/job")
    done = (job_state.get("progress") or {}).get("completion") == 100
    _request(url, "/api/connection", {"command": "disconnect"})
    if not over:
        return "hangs"
    return (
        "ended" if done and job_state.get("state") == "Operational" else f"stopped: {job_state.get('state')}"
    )


# Runs


def _print_job(host: Host, folder: Path, text: str, limit: float, *flags: str) -> tuple[dict[str, Any], str]:
    """Print a job with a host; return the printer's report and the host's result."""
    job, report, link = folder / "job.gcode", folder / "report.json", folder / "printer"
    job.write_text(text)
    report.unlink(missing_ok=True)
    serve = [sys.executable, "-m", "benchmarks.faulty_printer", str(link), str(job), str(report), *flags]
    with subprocess.Popen(serve, stdout=subprocess.PIPE, cwd=ROOT) as printer:
        assert printer.stdout is not None
        printer.stdout.readline()  # the printer is ready
        try:
            ended = host(link, job, limit)
        finally:
            printer.terminate()
            printer.wait(20)
    return json.loads(report.read_text()), ended


def _flags(baud: int, latency: float, *more: str) -> list[str]:
    return ["--baud", str(baud), "--latency", str(latency), *more]


def _wire_rate(text: str, baud: int) -> float:
    """Return the lines per second that the wire can carry, including numbers, checksums and newlines."""
    from printer_slicer.stream.framing import frame

    lines = text.encode().splitlines()
    sizes = [len(frame(number, line)) + 1 for number, line in enumerate(lines, 3)]
    return baud / 10 / (sum(sizes) / len(sizes))


def _print_rates(hosts: dict[str, Host], folder: Path, lines: int) -> None:
    text = _make_fast(lines)
    print("\nlines/s (share of the wire's)")
    for baud in BAUDS:
        wire = _wire_rate(text, baud)
        for latency in LATENCIES:
            row = []
            for name, host in hosts.items():
                seen, ended = _print_job(host, folder, text, 400.0, *_flags(baud, latency))
                rate = (seen["in_order"] - PREPARED - 1) / max(seen["seconds"], 1e-9)
                well = "" if seen["in_order"] == seen["commands"] else f" {seen['in_order']} lines, {ended}"
                row.append(f"{name} {rate:.0f} ({rate / wire:.0%}){well}")
            print(f"{baud} baud, {latency:g} ms, wire {wire:.0f}: {'; '.join(row)}", flush=True)


def _print_protocol_rates(lines: int) -> None:
    """Measure our host again in one process on a simulated clock: the limit of the protocol itself."""
    commands = _make_fast(lines).encode().splitlines()
    print("\nour protocol alone, simulated clock: lines/s (share of the wire's)")
    for baud in BAUDS:
        for latency in LATENCIES:
            times: list[float] = []
            machine = Machine(limits=MACHINES["quick"], coldest_extrusion=0.0)
            printer = SimulatedPrinter(machine, on_executed=lambda _: times.append(port.now()), boots=False)  # noqa: B023
            port = VirtualPort(printer, baud=baud, latency=latency / 2000)
            run(Streamer(commands, limits=MACHINES["quick"]), port, port.now)
            first, last = 10, len(commands) - 1  # far from the start and end of the job
            rate = (last - first) / (times[last] - times[first])
            print(
                f"{baud} baud, {latency:g} ms: {rate:.0f} ({rate / _wire_rate(_make_fast(lines), baud):.1%})"
            )


def _print_standstills(hosts: dict[str, Host], folder: Path, lines: int) -> None:
    text = circle(lines)
    print(
        f"\nchords of 0.2 mm at 60 mm/s, {lines} lines: standstills, seconds from the first to the last line"
    )
    for baud in BAUDS:
        for latency in LATENCIES:
            row = []
            for name, host in hosts.items():
                flags = _flags(baud, latency, "--machine", "part")
                seen, _ = _print_job(host, folder, text, 400.0, *flags)
                standstills = f"{seen['underruns']} ({seen['underrun_seconds']:.1f} s)"
                row.append(f"{name} {standstills}, {seen['seconds']:.1f} s")
            print(f"{baud} baud, {latency:g} ms: {'; '.join(row)}", flush=True)


def _print_faults(hosts: dict[str, Host], folder: Path, faults: Sequence[str]) -> None:
    text = circle(1500)
    print("\nfaults, 115200 baud, 1 ms, 1505 lines")
    for fault in faults:
        for name, host in hosts.items():
            flags = _flags(BAUDS[0], LATENCIES[0], "--machine", "part", "--fault", fault)
            begun = monotonic()
            seen, ended = _print_job(host, folder, text, FAULT_SECONDS, *flags)
            took = monotonic() - begun
            whole = (
                "all lines, once and in order"
                if seen["in_order"] == seen["commands"]
                else f"{seen['in_order']} lines"
            )
            more = f", {seen['strays']} out of order" if seen["strays"] else ""
            more += f", {seen['after_reset']} after the reset" if fault == "reset" else ""
            print(f"{fault}: {name}: {whole}{more}; {took:.0f} s; {ended[:150]}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
