"""Run print servers and hosts of other projects unchanged, each in its own Python environment.

`PRINTER_SLICER_HOSTS` names a folder with the environments `octoprint`, `printrun` and `moonraker`; docs/hosts.md
explains how to create them. If one is missing, its tests are skipped.
"""

from __future__ import annotations

import os
import re
import select
import socket
import subprocess
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPException
from pathlib import Path
from time import monotonic

import pytest

from tests.waiting import LAST_RESORT

__all__ = ["KEY", "free_port", "moonraker", "octoprint", "program", "running"]

FOLDER = os.environ.get("PRINTER_SLICER_HOSTS", "")
KEY = "0123456789ABCDEF0123456789ABCDEF"

_OCTOPRINT = """\
server: {firstRun: false, onlineCheck: {enabled: false}, pluginBlacklist: {enabled: false}}
plugins:
  _disabled: [announcements, softwareupdate, discovery, pluginmanager, tracking, errortracking, virtual_printer, backup]
%s"""
_MOONRAKER = """\
[server]
host: 127.0.0.1
port: %d
klippy_uds_address: %s
[authorization]
force_logins: false
%s
[machine]
provider: none
validate_service: false
"""


def program(host: str, name: str) -> Path:
    """A program of an environment; skips the test where there is none."""
    path = Path(FOLDER, host, "bin", name)
    if not FOLDER or not path.exists():
        pytest.skip(f"{host} is not installed")
    return path


def free_port() -> int:
    """A port of this computer that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@contextmanager
def running(*command: object, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process for as long as the block runs."""
    bare = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    with log.open("wb") as file:
        process = subprocess.Popen(list(map(str, command)), stdout=file, stderr=subprocess.STDOUT, env=bare)
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(LAST_RESORT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(LAST_RESORT)


def answers(url: str, process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait until somebody answers there, whatever it is."""
    end = monotonic() + LAST_RESORT
    while monotonic() < end:
        assert process.poll() is None, log.read_text()[-2000:]
        try:
            with urllib.request.urlopen(url, timeout=LAST_RESORT):
                return
        except urllib.error.HTTPError as error:
            if error.code in {401, 403}:
                return
        except (OSError, HTTPException):
            pass
        select.select([], [], [], 0.25)
    raise AssertionError(f"{url} does not answer: {log.read_text()[-2000:]}")


@contextmanager
def octoprint(folder: Path, *, more: str = "") -> Iterator[str]:
    """The address of an OctoPrint with one user, whose key is `KEY`; more goes into its configuration."""
    binary, port = program("octoprint", "octoprint"), free_port()
    folder.mkdir(exist_ok=True)
    (folder / "config.yaml").write_text(_OCTOPRINT % more)
    make = [binary, "--basedir", folder, "user", "add", "tester", "--password", "secret", "--admin"]
    with running(*make, log=folder / "user.log") as process:
        assert process.wait(LAST_RESORT) == 0, (folder / "user.log").read_text()
    users = folder / "users.yaml"
    users.write_text(re.sub("apikey: .*", f"apikey: {KEY}", users.read_text()))
    log, url = folder / "server.log", f"http://127.0.0.1:{port}"
    serve = [
        binary,
        "--basedir",
        folder,
        "serve",
        "--host",
        "127.0.0.1",
        "--port",
        port,
        "--iknowwhatimdoing",
    ]
    with running(*serve, log=log) as process:
        answers(f"{url}/api/version", process, log)
        yield url


@contextmanager
def moonraker(folder: Path, *, trusts: bool = True) -> Iterator[str]:
    """The address of a Moonraker without Klipper, that asks us for a key or not."""
    binary, port = program("moonraker", "moonraker"), free_port()
    (folder / "config").mkdir(parents=True)
    (folder / "gcodes").mkdir()
    who = "trusted_clients:\n  127.0.0.1" if trusts else ""
    (folder / "config" / "moonraker.conf").write_text(_MOONRAKER % (port, folder / "klippy.sock", who))
    log, url = folder / "server.log", f"http://127.0.0.1:{port}"
    with running(binary, "-d", folder, "-n", log=log) as process:
        answers(f"{url}/server/info", process, log)
        yield url
