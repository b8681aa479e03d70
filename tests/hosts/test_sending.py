"""Files sent to print servers: OctoPrint and Moonraker as they are, PrusaLink and Duet as they are documented."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from threading import Thread

import pytest

from printer_slicer.errors import PortError, UsageError
from printer_slicer.sending import SERVERS, Upload, send
from tests.cli.command_line import is_message, typed
from tests.hosts.others import KEY, moonraker, octoprint
from tests.hosts.small_servers import duet, fixed, prusalink


@pytest.fixture(autouse=True)
def _no_key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PRINTER_SLICER_KEY", raising=False)


@cache
def many_moves() -> bytes:
    """So many that they are sent in more than twenty pieces."""
    why = b"long remarks make a large file of few commands " * 5
    lines = (b"G1 X%d Y%d E%.2f F1800 ; %s\n" % (i % 200, i % 180, i / 20, why) for i in range(6_000))
    return b"G28\nM109 S210\n" + b"".join(lines)


@pytest.fixture
def gcode(tmp_path: Path) -> Path:
    """A file that is sent in many pieces."""
    path = tmp_path / "a part.gcode"
    path.write_bytes(many_moves())
    return path


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "key"
    path.write_text(f"{KEY}\n")
    return path


# OctoPrint


@pytest.fixture(scope="module")
def octo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    folder = tmp_path_factory.mktemp("octoprint")
    with octoprint(folder) as url:
        yield url, folder / "uploads"


def test_octoprint_gets_the_file_as_it_is(octo: tuple[str, Path], gcode: Path, key_file: Path) -> None:
    url, uploads = octo
    done = typed("send", gcode, "--to", "octoprint", url, "--key-file", key_file, "--json")
    facts = json.loads(done.out)

    assert (done.code, done.err) == (0, "")
    assert facts["bytes"] == gcode.stat().st_size
    assert (uploads / facts["place"]).read_bytes() == gcode.read_bytes()


def test_octoprint_puts_it_into_a_folder(octo: tuple[str, Path], gcode: Path, key_file: Path) -> None:
    url, uploads = octo
    done = typed(
        *("send", gcode, "--to", "octoprint", url, "--key-file", key_file),
        *("--folder", "parts/small", "--name", "b.gcode"),
    )

    assert done.code == 0, done.err
    assert (uploads / "parts" / "small" / "b.gcode").read_bytes() == gcode.read_bytes()


def test_octoprint_without_a_printer_does_not_print(
    octo: tuple[str, Path], gcode: Path, key_file: Path
) -> None:
    done = typed("send", gcode, "--to", "octoprint", octo[0], "--key-file", key_file, "--print")

    assert done.code == 4
    assert is_message(done, "was uploaded, but the print did not start")


def test_octoprint_refuses_a_wrong_key(
    octo: tuple[str, Path], gcode: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = typed("send", gcode, "--to", "octoprint", octo[0])
    monkeypatch.setenv("PRINTER_SLICER_KEY", "wrong")
    wrong = typed("send", gcode, "--to", "octoprint", octo[0])
    monkeypatch.setenv("PRINTER_SLICER_KEY", KEY)
    right = typed("send", gcode, "--to", "octoprint", octo[0])

    assert (missing.code, wrong.code, right.code) == (4, 4, 0)
    assert is_message(missing, "a key is required", "--key-file")
    assert is_message(wrong, "the key was rejected", "PRINTER_SLICER_KEY")


def test_octoprint_is_not_taken_for_another_server(octo: tuple[str, Path], gcode: Path) -> None:
    for kind in ("moonraker", "prusalink", "duet"):
        done = typed("send", gcode, "--to", kind, octo[0])
        assert done.code == 4
        assert is_message(done, kind)


# Moonraker


def test_moonraker_gets_the_file_as_it_is(tmp_path: Path, gcode: Path) -> None:
    with moonraker(tmp_path / "data") as url:
        done = typed("send", gcode, "--to", "moonraker", url, "--folder", "parts/small", "--json")
        printed = typed("send", gcode, "--to", "moonraker", url, "--print")

    assert (done.code, done.err) == (0, "")
    place = json.loads(done.out)["place"]
    assert place == "parts/small/a part.gcode"
    assert (tmp_path / "data" / "gcodes" / place).read_bytes() == gcode.read_bytes()
    assert printed.code == 4
    assert is_message(printed, "Klipper is not ready")
    assert not (tmp_path / "data" / "gcodes" / gcode.name).exists()


def test_moonraker_refuses_whom_it_does_not_know(tmp_path: Path, gcode: Path) -> None:
    with moonraker(tmp_path / "data", trusts=False) as url:
        done = typed("send", gcode, "--to", "moonraker", url)

    assert done.code == 4
    assert is_message(done, "401", "a key is required")
    assert "Traceback" not in done.err


# PrusaLink


def test_prusalink_by_key(gcode: Path, key_file: Path) -> None:
    with prusalink(key=KEY) as seen:
        done = typed("send", gcode, "--to", "prusalink", seen.url, "--key-file", key_file)
        assert (done.code, done.err) == (0, "")
        assert seen.files == {"/usb/a part.gcode": gcode.read_bytes()}
        assert seen.started == []

        again = typed("send", gcode, "--to", "prusalink", seen.url, "--key-file", key_file, "--print")
        assert again.code == 0
        assert seen.started == ["/usb/a part.gcode"]


def test_prusalink_by_password(gcode: Path, key_file: Path) -> None:
    with prusalink(key=KEY, user="maker") as seen:
        who = ("--key-file", key_file, "--user", "maker")
        done = typed("send", gcode, "--to", "prusalink", seen.url, *who, "--print")

        assert (done.code, done.err) == (0, "")
        assert seen.files == {"/usb/a part.gcode": gcode.read_bytes()}
        assert seen.started == ["/usb/a part.gcode"]
        wrong = typed("send", gcode, "--to", "prusalink", seen.url, "--key", "no", "--user", "maker")
        assert wrong.code == 4
        assert is_message(wrong, "401", "the key was rejected")


def test_what_is_printed_at_once_is_looked_at_before_it_is_sent(tmp_path: Path) -> None:
    job = tmp_path / "hot.gcode"
    job.write_text("G28\nM118 " + "x" * 150 + "\nM104 S400\n", encoding="ascii")
    with prusalink() as seen:
        to = ("send", job, "--to", "prusalink", seen.url, "--key", "secret")
        refused = typed(*to, "--print")
        assert refused.code == 2
        assert is_message(refused, "line 3", "[temperature]", "--allow temperature")
        assert (seen.files, seen.started) == ({}, [])

        assert typed(*to).code == 0
        assert seen.started == []
        allowed = typed(*to, "--print", "--allow", "temperature")
        assert allowed.code == 0, allowed.err
        assert seen.started == ["/usb/hot.gcode"]


def test_prusalink_says_what_it_does_not_take(gcode: Path) -> None:
    with prusalink() as seen:
        done = typed("send", gcode, "--to", "prusalink", seen.url, "--key", "secret", "--name", "a.g")
        assert done.code == 4
        assert is_message(done, "415", "ends in .gcode")
    with prusalink(full=True) as seen:
        done = typed("send", gcode, "--to", "prusalink", seen.url, "--key", "secret")
        assert is_message(done, "no writable storage")


# Duet


@pytest.mark.parametrize("by_computer", [False, True])
def test_duet(gcode: Path, by_computer: bool) -> None:
    with duet(by_computer=by_computer) as seen:
        done = typed("send", gcode, "--to", "duet", seen.url, "--key", "secret", "--print")

        assert (done.code, done.err) == (0, "")
        assert seen.files == {"0:/gcodes/a part.gcode": gcode.read_bytes()}
        assert seen.started == ["0:/gcodes/a part.gcode"]
        wrong = typed("send", gcode, "--to", "duet", seen.url, "--key", "wrong")
        assert wrong.code == 4
        assert "--key-file" in wrong.err


def test_duet_without_room(gcode: Path) -> None:
    with duet(full=True) as seen:
        done = typed("send", gcode, "--to", "duet", seen.url, "--key", "secret", "--print")

        assert done.code == 4
        assert is_message(done, "was not accepted", "free space")
        assert seen.started == []
        assert seen.requests[-1] == "GET /rr_disconnect"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (2, "all sessions are in use\n  Close other web pages of the printer, or try again later"),
        (7, "the printer did not open a session (error 7)\n  Check the web page of the printer"),
    ],
)
def test_duet_says_why_it_gives_no_session(code: int, said: str, gcode: Path) -> None:
    with duet(no_session=code) as seen:
        done = typed("send", gcode, "--to", "duet", seen.url, "--key", "secret")

        assert (done.code, done.err) == (4, f"printer-slicer: {seen.url}: {said}\n")
        assert seen.files == {}


# Servers that are another one, or do not print


READY = {"/server/info": (200, {"result": {"klippy_state": "ready"}})}
API = {"/api/version": (200, {"api": "0.1"})}


@pytest.mark.parametrize(
    ("kind", "says", "said"),
    [
        (
            "moonraker",
            {"/server/info": (200, {})},
            "the server at this address is not Moonraker\n  Check the address and the kind of server after --to",
        ),
        (
            "moonraker",
            {"/server/info": (200, {"result": None})},
            "the server at this address is not Moonraker\n  Check the address and the kind of server after --to",
        ),
        (
            "moonraker",
            {"/server/info": (200, {"result": {"klippy_state": "startup"}})},
            (
                "Klipper is not ready (startup), so the print cannot start\n"
                "  Check the web page of the server, or leave out --print to upload only"
            ),
        ),
        (
            "moonraker",
            READY | {"/server/files/upload": (201, {"item": {"path": "b.gcode"}, "print_started": False})},
            "b.gcode was uploaded, but the print did not start\n  Check whether another print is running",
        ),
        (
            "octoprint",
            {"/api/version": (200, {})},
            "the server at this address is not OctoPrint\n  Check the address and the kind of server after --to",
        ),
        (
            "octoprint",
            API
            | {"/api/files/local": (201, {"files": {"local": {"path": "b.gcode"}}, "effectivePrint": False})},
            (
                "b.gcode was uploaded, but the print did not start\n"
                "  Connect OctoPrint to its printer and start the print there"
            ),
        ),
    ],
)
def test_what_is_not_printed_is_told_with_the_reason(
    kind: str, says: dict[str, tuple[int, object]], said: str, tmp_path: Path
) -> None:
    job = tmp_path / "b.gcode"
    job.write_text("G28\n", encoding="ascii")
    with fixed(says) as seen:
        done = typed("send", job, "--to", kind, seen.url, "--print")

    assert (done.code, done.err) == (4, f"printer-slicer: {seen.url}: {said}\n")


@pytest.mark.parametrize(
    ("state", "advice"),
    [
        ("Printing from SD", "when the current print has ended (Printing from SD)"),
        ("Paused", "when the current print has ended (Paused)"),
        ("Offline (Error: timeout)", "Connect OctoPrint to its printer"),
        ("Operational", "Check the printer in OctoPrint (its state is 'Operational')"),
    ],
)
def test_octoprint_that_does_not_print_is_asked_why(state: str, advice: str, tmp_path: Path) -> None:
    job = tmp_path / "b.gcode"
    job.write_text("G28\n", encoding="ascii")
    says = {
        "/api/version": (200, {"api": "0.1"}),
        "/api/files/local": (201, {"effectivePrint": False}),
        "/api/job": (200, {"state": state}),
    }
    with fixed(says) as seen:
        done = typed("send", job, "--to", "octoprint", seen.url, "--print")

    assert done.code == 4
    assert advice in done.err
    assert ("Connect OctoPrint" in done.err) == state.startswith("Offline")


# All of them


def test_a_key_that_is_none_is_refused_without_being_shown(gcode: Path) -> None:
    done = typed("send", gcode, "--to", "octoprint", "there", "--key", "schlüssel")

    assert (done.code, done.err) == (
        2,
        (
            "printer-slicer: the key contains 'ü', which is not allowed in a key\n"
            "  Check --key-file, --key or the variable PRINTER_SLICER_KEY\n"
        ),
    )


@pytest.mark.parametrize("kind", sorted(SERVERS))
def test_a_file_that_cannot_be_read_is_told_before_the_server_is_asked(kind: str, tmp_path: Path) -> None:
    gone = tmp_path / "gone.gcode"
    with fixed({}) as seen, pytest.raises(UsageError) as caught:
        send(Upload(gone, "a.gcode"), kind, seen.url)

    assert str(caught.value) == (
        f"{gone}: cannot be read: No such file or directory\n  Check the name and permissions of the file"
    )
    assert seen.requests == []


def test_progress_goes_from_nothing_to_all_of_it(gcode: Path) -> None:
    told: list[tuple[int, int]] = []
    size = gcode.stat().st_size
    with prusalink() as seen:
        upload = Upload(gcode, "a.gcode", on_progress=lambda done, whole: told.append((done, whole)))
        send(upload, "prusalink", seen.url, key="secret")

    assert len(told) > 20
    assert sorted(told) == told
    assert told[-1] == (size, size)


@pytest.mark.parametrize("kind", sorted(SERVERS))
def test_nobody_there(kind: str, gcode: Path) -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))  # bound, but nobody listens
        done = typed("send", gcode, "--to", kind, f"127.0.0.1:{unused.getsockname()[1]}")

    assert done.code == 4
    assert is_message(done, "cannot connect", "server is running")


@pytest.mark.parametrize("kind", sorted(SERVERS))
def test_a_server_that_says_nothing(kind: str, gcode: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(PortError, match="no answer in time"):
            send(Upload(gcode, "a.gcode"), kind, url, timeout=0.3)


@pytest.mark.parametrize("kind", sorted(SERVERS))
@pytest.mark.parametrize(
    "answer", [b"", b"nonsense\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\n[42]"]
)
def test_a_server_that_is_none(kind: str, answer: bytes, gcode: Path) -> None:
    def one(server: socket.socket) -> None:
        while True:
            try:
                other, _ = server.accept()
            except OSError:
                return
            with other:
                other.recv(4096)
                other.sendall(answer)

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = Thread(target=one, args=(server,))
        thread.start()
        with pytest.raises(PortError):
            send(Upload(gcode, "a.gcode"), kind, f"127.0.0.1:{server.getsockname()[1]}", timeout=5)
        server.shutdown(socket.SHUT_RDWR)
    thread.join()


@pytest.mark.parametrize("url", ["ftp://there", "http://", "://x"])
def test_addresses_that_are_none(url: str, gcode: Path) -> None:
    with pytest.raises(UsageError, match="not the address of a server"):
        send(Upload(gcode, "a.gcode"), "octoprint", url)


@pytest.mark.parametrize("name", ["", "../a.gcode", "a/b.gcode", "a\n.gcode"])
def test_names_that_are_none(name: str, gcode: Path) -> None:
    with pytest.raises(UsageError, match="not a valid file name"):
        Upload(gcode, name)


def test_what_cannot_be_sent_is_named(tmp_path: Path, gcode: Path) -> None:
    model = tmp_path / "a.stl"
    model.write_bytes(b"solid")

    assert is_message(typed("send", model, "--to", "duet", "there"), "not a G-code file", "Slice it first")
    assert is_message(typed("send", tmp_path / "b.gcode", "--to", "duet", "there"), "no such file")
    assert is_message(typed("send", gcode, "--to", "prusa", "there"), "unknown kind", "prusalink")
    assert is_message(
        typed("send", gcode, "--to", "duet", "there", "--folder", "../.."), "not a valid folder"
    )
    missing = typed("send", gcode, "--to", "duet", "there", "--key-file", tmp_path / "none")
    assert is_message(missing, "cannot be read")
    assert os.environ.get("PRINTER_SLICER_KEY") is None
