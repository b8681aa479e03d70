"""Measure this server and OctoPrint side by side, one after the other in each round.

    python -m benchmarks.octoprint --octoprint VENV/bin/octoprint [--rounds 3] [--requests 300]

Both begin with an empty folder. Printed are the medians of the rounds: CPU time from the start to the first answer,
memory when nothing happens, CPU time of small requests and of an upload of 3 MB, and what a browser loads for the page
with an empty cache. OctoPrint runs without the plug-ins that ask servers on the internet.
"""

from __future__ import annotations

import argparse
import gzip
import http.client
import json
import os
import re
import secrets
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from threading import Event
from typing import Any
from urllib.parse import urljoin

PORT = 5078
CONFIG = """
server: {firstRun: false, startOnceInSafeMode: false, onlineCheck: {enabled: false}, pluginBlacklist: {enabled: false}}
plugins:
  _disabled: [tracking, announcements, softwareupdate, errortracking, pluginmanager, discovery]
"""
PRINTERS = '[left]\nport = "sim:"\nprofile = "marlin_220"\n'
Measured = dict[str, float]


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--octoprint", required=True, help="path of the command octoprint")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--requests", type=int, default=300)
    arguments = parser.parse_args()
    ours, theirs = list[Measured](), list[Measured]()
    for _ in range(arguments.rounds):
        with tempfile.TemporaryDirectory() as name, run_own_server(Path(name)) as (process, key):
            ours.append(measure(process, key, arguments.requests))
        with (
            tempfile.TemporaryDirectory() as name,
            run_octoprint(arguments.octoprint, Path(name)) as (process, key),
        ):
            theirs.append(measure(process, key, arguments.requests))
    print(f"{'':36}{'printer-slicer':>16}{'OctoPrint':>12}")
    for what in ours[0]:
        own, other = (median(one[what] for one in rounds) for rounds in (ours, theirs))
        print(f"{what:36}{own:16.4g}{other:12.4g}")


@contextmanager
def run_own_server(folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Yield the process of this server, and a key."""
    (folder / "printers.toml").write_text(PRINTERS)
    environment = os.environ | {"PRINTER_SLICER_STATE": str(folder)}
    command = [
        sys.executable,
        "-m",
        "printer_slicer",
        "serve",
        "--printers-file",
        str(folder / "printers.toml"),
    ]
    create = [*command, "--new-key", "benchmark", "--scopes", "all", "--json"]
    key = json.loads(subprocess.run(create, env=environment, check=True, capture_output=True).stdout)["text"]
    with run_process([*command, "--listen", f"127.0.0.1:{PORT}"], environment) as process:
        yield process, key


@contextmanager
def run_octoprint(program: str, folder: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Yield the process of OctoPrint, and a key."""
    (folder / "config.yaml").write_text(CONFIG)
    command = [program, "--basedir", str(folder)]
    add = [*command, "user", "add", "benchmark", "--password", secrets.token_hex(8), "--admin"]
    subprocess.run(add, check=True, capture_output=True)
    key = secrets.token_hex(16).upper()
    users = (folder / "users.yaml").read_text()
    (folder / "users.yaml").write_text(re.sub(r"apikey: .*", f"apikey: {key}", users))
    words = ["serve", "--iknowwhatimdoing", "--host", "127.0.0.1", "--port", str(PORT)]
    with run_process([*command, *words], dict(os.environ)) as process:
        yield process, key


@contextmanager
def run_process(command: list[str], environment: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    """Yield a process that is ended afterwards."""
    nothing = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=environment, **nothing) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.terminate()


def measure(process: subprocess.Popen[bytes], key: str, n_requests: int) -> Measured:
    """Return the figures of a server that was just started."""
    pause = Event()
    while not is_answering(key):
        pause.wait(0.05)
    measured = {"start, CPU s": read_cpu(process)}
    pause.wait(12)
    measured["memory, MB"] = read_memory(process, "VmRSS")
    for path in ("/api/version", "/api/job"):
        request(path, key)
        begin = read_cpu(process)
        for _ in range(n_requests):
            request(path, key)
        measured[f"GET {path}, CPU ms"] = 1000 * (read_cpu(process) - begin) / n_requests
    begin = read_cpu(process)
    upload(key)
    pause.wait(3)
    measured["upload of 3 MB, CPU s"] = read_cpu(process) - begin
    sizes = load_page(key)
    measured["page, kB as sent"], measured["page, requests"] = sum(sizes) / 1000, len(sizes)
    measured["most memory, MB"] = read_memory(process, "VmHWM")
    return measured


def is_answering(key: str) -> bool:
    """Return whether the server answers a request with success."""
    try:
        request("/api/version", key)
    except (OSError, http.client.HTTPException):
        return False
    return True


def request(path: str, key: str, body: bytes | None = None, **headers: str) -> tuple[bytes, Any]:
    """Return body and headers of the answer to a GET, or with a body to a POST.

    Raises:
        OSError: the server does not answer with success.
    """
    connection = http.client.HTTPConnection("127.0.0.1", PORT)
    try:
        wanted = {"X-Api-Key": key, "Accept-Encoding": "gzip"} | {
            name.replace("_", "-"): value for name, value in headers.items()
        }
        connection.request("GET" if body is None else "POST", path, body, wanted)
        answer = connection.getresponse()
        content = answer.read()
        if answer.status >= 300:
            raise OSError(f"{path}: {answer.status} {content[:200]!r}")
        return content, answer.headers
    finally:
        connection.close()


def upload(key: str) -> None:
    """Send a file of G-code."""
    gcode = b"".join(b"G1 X%d.%03d Y%d E0.0123 F1200\n" % (n % 190, n % 997, n % 180) for n in range(100_000))
    head = b'--x\r\nContent-Disposition: form-data; name="file"; filename="part.gcode"\r\n\r\n'
    form = head + gcode + b"\r\n--x--\r\n"
    request("/api/files/local", key, form, Content_Type="multipart/form-data; boundary=x")


def load_page(key: str) -> list[int]:
    """Return the bytes of each response that a browser loads for the page: itself, scripts, styles and pictures."""
    content, headers = request("/", key)
    text = (gzip.decompress(content) if headers.get("Content-Encoding") == "gzip" else content).decode()
    links = re.findall(
        r"<script[^>]+src=\"([^\"]+)\"|<link[^>]+rel=\"stylesheet\"[^>]+href=\"([^\"]+)\"", text
    )
    links += re.findall(
        r"<(link)[^>]+href=\"([^\"]+\.(?:css|js)[^\"]*)\"|<(?:img)[^>]+src=\"(/[^\"]+)\"", text
    )
    paths = {urljoin("/", path) for found in links for path in found if path and path != "link"}
    return [len(content), *(len(request(path, key)[0]) for path in sorted(paths) if path.startswith("/"))]


def read_cpu(process: subprocess.Popen[bytes]) -> float:
    """Return the CPU time of a process so far, s, without its children."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(") ", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def read_memory(process: subprocess.Popen[bytes], what: str) -> float:
    """Return the memory of a process, MB."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(re.findall(rf"{what}:\s+(\d+)", status)[0]) / 1000


if __name__ == "__main__":
    main()
