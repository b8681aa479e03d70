"""The DTR line, which resets many boards, is set as requested whenever a print or a resume opens the port."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Thread

import pytest

from printer_slicer.errors import PrinterSlicerError
from printer_slicer.inspection.lint.scan import lint_text
from printer_slicer.printing import job_store as store
from printer_slicer.printing import print_job, resume_print
from printer_slicer.printing.host_settings import make_host_settings
from printer_slicer.profile import load_profile
from printer_slicer.sim.rfc2217 import Rfc2217Server
from tests.waiting import LAST_RESORT

PROFILE = load_profile("marlin_220", "pla")
JOB = lint_text("job.gcode", b"M104 S200\nG28\nM109 S200\nG1 X10 F600\nM104 S0\n", PROFILE)
# pyserial calls a method of threads that is no longer recommended.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name).*:DeprecationWarning")
DTR_ON, DTR_OFF = b"\xff\xfa\x2c\x05\x08\xff\xf0", b"\xff\xfa\x2c\x05\x09\xff\xf0"


class Listener:
    """An RFC 2217 port that hangs up at the first line for the printer: by then it was told how DTR shall be.

    Attributes:
        url: its address.
        heard: what came.
    """

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"rfc2217://127.0.0.1:{self._server.getsockname()[1]}"
        self.heard = b""
        Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        negotiator = Rfc2217Server()
        with suppress(OSError), self._server.accept()[0] as connection:
            connection.settimeout(LAST_RESORT)
            while data := connection.recv(4096):
                self.heard += data
                if negotiator.decode(data):
                    return
                connection.sendall(negotiator.take_answers())

    def close(self) -> None:
        """Listen no more."""
        self._server.close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    there = Listener()
    yield there
    there.close()


def printed(url: str, _job_store: Path, dtr: bool) -> None:
    print_job(JOB, PROFILE, url, dtr=dtr)


def resumed(url: str, job_store: Path, dtr: bool) -> None:
    store.create_print(
        job_store, JOB.name, JOB.text, store.PortAddress(url, 115200), make_host_settings(PROFILE)
    ).release()
    resume_print(store.find_print(job_store, "", running=False), JOB, dtr=dtr)


@pytest.mark.parametrize("begin", [printed, resumed])
@pytest.mark.parametrize("dtr", [True, False])
def test_dtr_is_as_requested(
    begin: Callable[[str, Path, bool], None], dtr: bool, listener: Listener, tmp_path: Path
) -> None:
    with pytest.raises(PrinterSlicerError):
        begin(listener.url, tmp_path / "prints", dtr)

    assert (DTR_OFF in listener.heard, DTR_ON in listener.heard) == (not dtr, dtr)
