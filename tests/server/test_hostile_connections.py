"""Clients that mean harm, on real sockets while a print goes on: they achieve nothing, and the print is exact."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from printer_slicer.server import connections, receiving
from printer_slicer.server.running import Listener
from tests.server.client import GCODE, form
from tests.server.live import (
    LiveServer,
    add_job,
    read_all,
    read_response,
    run_live_server,
    status_of,
    supervise,
)
from tests.waiting import LAST_RESORT, until

N_MOVES = 4000
BEGINNING = b"G28\nM83\nM109 S200\nG1 Z0.2 F600\n"
PRINT = BEGINNING + b"".join(b"G1 X%d Y%d E0.1 F6000\n" % (10 + n % 40, 10 + n % 7) for n in range(N_MOVES))


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
    monkeypatch.setattr(connections, "_HEAD_TIMEOUT", 2.0)
    monkeypatch.setattr(connections, "_WRITE_TIMEOUT", 2.0)
    monkeypatch.setattr(receiving, "_SILENCE", 2.0)
    monkeypatch.setattr(receiving, "_BODY_TIME", 2.0)
    with run_live_server(tmp_path) as server:
        yield server


def send_a_head_slowly(live: LiveServer) -> None:
    with live.connect() as connection:
        until(lambda: not is_sent(connection, b"G"))


def is_sent(connection: socket.socket, data: bytes) -> bool:
    """Send bytes; return whether the connection is still open."""
    try:
        connection.sendall(data)
    except OSError:
        return False
    return True


def send_no_head(live: LiveServer) -> None:
    with live.connect() as connection:
        assert read_all(connection) == b""


def begin_a_second_head(live: LiveServer) -> None:
    with live.connect() as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\nGET / HTTP/1.1\r\nX-Slow: ")
        assert read_all(connection).count(b"HTTP/1.1 ") == 1


def send_a_head_without_an_end(live: LiveServer) -> None:
    for first in (b"GET /" + b"a" * 9, b"GET / HTTP/1.1\r\nX: ", b"GET / HTTP/1.1\r\n", b"\r\n"):
        with live.connect() as connection:
            assert send_endlessly(
                connection, first, b"\r\n" * 4096 if first == b"\r\n" else b"x: y\r\n" * 1365
            )


def send_trailers_without_an_end(live: LiveServer) -> None:
    content_type = "Content-Type: multipart/form-data; boundary=x"
    head = live.head("POST /v1/files", "Transfer-Encoding: chunked", content_type)
    with live.connect() as connection:
        assert send_endlessly(connection, head + b"0\r\n", b"x: y\r\n" * 1365)


def send_endlessly(connection: socket.socket, first: bytes, piece: bytes) -> bool:
    """Send a piece up to 4000 times, 33 MB; return whether the server has closed the connection before."""
    return not is_sent(connection, first) or not all(is_sent(connection, piece) for _ in range(4000))


def send_a_body_slowly(live: LiveServer) -> None:
    for path in ("/v1/jobs", "/v1/session", "/printers/left/api/job"):
        response = live.talk(live.head(f"POST {path}", "Content-Length: 50"), b'{"')
        assert status_of(response) == 408, response


def stop_in_an_upload(live: LiveServer) -> None:
    sent = form(("file", "a.gcode", b"G28\n" * 9))
    head = live.head(
        "POST /v1/files", f"Content-Type: {sent['headers']['content-type']}", "Content-Length: 9000"
    )
    assert status_of(live.talk(head, sent["content"][:150])) == 408


def announce_5_gb(live: LiveServer) -> None:
    for expect in ((), ("Expect: 100-continue",)):
        response = live.talk(live.head("POST /v1/files", "Content-Length: 5368709120", *expect))
        assert status_of(response) == 413
    no_key = live.head("POST /v1/files", "Content-Length: 5000", "Expect: 100-continue", key="wrong")
    assert status_of(live.talk(no_key)) == 401


def send_more_than_announced(live: LiveServer) -> None:
    response = live.talk(
        live.head("POST /v1/jobs", "Content-Length: 2"), b"{}" + b"\r\nGET /v1/keys HTTP/1.1\r\n" * 50
    )
    assert response.count(b"HTTP/1.1 ") == 1


def confuse_lengths(live: LiveServer) -> None:
    for headers in (
        ("Content-Length: 5", "Content-Length: 6"),
        ("Content-Length: 5", "Transfer-Encoding: chunked"),
        ("Content-Length: -1",),
        ("Content-Length: 0x10",),
        ("Content-Length: " + "9" * 40,),
        ("Transfer-Encoding: chunked, identity",),
        ("Transfer-Encoding : chunked",),
    ):
        assert status_of(live.talk(live.head("POST /v1/jobs", *headers), b"0\r\n\r\n")) in {0, 400, 408}, (
            headers
        )


def send_100_000_parts(live: LiveServer) -> None:
    part = b'--x\r\nContent-Disposition: form-data; name="a"\r\n\r\n1\r\n'
    body = part * 100_000 + b"--x--\r\n"
    head = live.head(
        "POST /v1/files", "Content-Type: multipart/form-data; boundary=x", f"Content-Length: {len(body)}"
    )
    assert status_of(live.talk(head, body)) in {0, 400}  # 0: the answer is lost with the rest of the body
    assert live.queue.list_files(1)[0].name == "part.gcode"


def send_too_much_without_a_length(live: LiveServer) -> None:
    sent = form(("file", "big.gcode", b""))
    content_type = f"Content-Type: {sent['headers']['content-type']}"
    chunk = b"10000\r\n" + b"G28 ;" * 13107 + b"\n\r\n"
    before = len(live.queue.list_files())
    begin = sent["content"][: sent["content"].rindex(b"\r\n--")]
    head = live.head("POST /v1/files", content_type, "Transfer-Encoding: chunked")
    response = live.talk(head, b"%x\r\n" % len(begin) + begin + b"\r\n", *[chunk] * 200)
    assert status_of(response) in {0, 413}
    assert len(live.queue.list_files()) == before
    assert not list((live.queue.folder / "files" / "incoming").iterdir())


def go_on_after_the_answer(live: LiveServer) -> None:
    head = live.head("POST /v1/files", "Content-Length: 5368709120")
    with live.connect() as connection:
        assert is_sent(connection, head)
        assert not all(is_sent(connection, b"x" * 65536) for _ in range(1000))


def split_headers(live: LiveServer) -> None:
    for name in ("a%0d%0aSet-Cookie:%20x=1", "a\\r\\nSet-Cookie: x=1"):
        response = live.get(f"/printers/{name}/api/printer".replace(" ", "%20"))
        assert b"set-cookie" not in response.lower().split(b"\r\n\r\n")[0]
    sent = form(("file", "a\r\nSet-Cookie: x=1\r\n.gcode", GCODE))
    content_type = f"Content-Type: {sent['headers']['content-type']}"
    length = f"Content-Length: {len(sent['content'])}"
    response = live.talk(
        live.head("POST /printers/left/api/files/local", content_type, length), sent["content"]
    )
    assert b"\nset-cookie" not in response.lower().split(b"\r\n\r\n")[0]


def forge_the_host(live: LiveServer) -> None:
    for host in (
        "evil.example",
        "localhost.evil.example",
        "localhost@evil",
        "",
        "localhost\tevil",
        "[::ffff:7f00:1]",
    ):
        head = f"GET /v1/me HTTP/1.1\r\nHost: {host}\r\nX-Api-Key: {live.key}\r\nConnection: close\r\n\r\n"
        assert status_of(live.talk(head.encode())) in {400, 421}, host
    twice = b"GET /v1/me HTTP/1.1\r\nHost: localhost\r\nHost: evil\r\nConnection: close\r\n\r\n"
    assert status_of(live.talk(twice)) in {400, 421}
    assert (
        status_of(live.talk(b"GET http://evil.example/v1/me HTTP/1.1\r\nHost: evil.example\r\n\r\n")) == 421
    )
    assert status_of(live.talk(b"GET /v1/me HTTP/1.0\r\n\r\n")) == 421


def open_a_socket_from_another_page(live: LiveServer) -> None:
    upgrade = (
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
    )
    for origin in ("http://evil.example", "null", "http://localhost.evil.example", "file://"):
        head = live.head("GET /v1/feed", *upgrade, f"Origin: {origin}").replace(
            b"Connection: close", b"Connection: Upgrade"
        )
        assert status_of(live.talk(head)) == 403, origin
    head = live.head("GET /v1/feed", *upgrade, key="wrong").replace(
        b"Connection: close", b"Connection: Upgrade"
    )
    assert status_of(live.talk(head)) == 403


def send_large_frames(live: LiveServer) -> None:
    upgrade = (
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==",
    )
    head = live.head("GET /v1/feed", *upgrade).replace(b"Connection: close", b"Connection: Upgrade")
    with live.connect() as connection:
        connection.sendall(head)
        assert status_of(connection.recv(100)) == 101
        connection.sendall(b"\x82\xff" + (1 << 40).to_bytes(8, "big") + b"\0\0\0\0" + b"x" * 70_000)
        read_all(connection)  # until the server closes it


def guess_keys(live: LiveServer) -> None:
    id_ = live.key.split("_")[1]
    with live.connect() as connection:
        request = b"GET /v1/me HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: ps_%s_%04d\r\n\r\n"
        for n in range(300):
            connection.sendall(request % (id_.encode(), n))
            assert status_of(read_response(connection)) == 401
    assert status_of(live.get("/v1/me")) == 200


def open_many_connections(live: LiveServer) -> None:
    with ExitStack() as stack, pytest.MonkeyPatch.context() as patch:
        patch.setattr(connections, "_HEAD_TIMEOUT", LAST_RESORT)
        opened = [stack.enter_context(live.connect()) for _ in range(130)]
        assert [read_all(connection) for connection in opened[100:]] == [b""] * 30
    until(lambda: not live.server.server_state.connections)


def read_nothing(live: LiveServer) -> None:
    file = live.queue.add_file("long.gcode", [b"G28 ; long\n" * 2_000_000])
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", live.port))
        connection.sendall(live.head(f"GET /v1/files/{file.id}/content"))
        until(lambda: live.server.server_state.connections)
        until(lambda: not live.server.server_state.connections)
        assert len(read_all(connection)) < file.size


def ask_for_odd_paths(live: LiveServer) -> None:
    for path in (
        "/../../etc/passwd",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/page/..%2f..%2f..%2fsecret",
        "/page/%00.js",
        "/v1/files/..%2f..%2faccess.db/content",
        "/v1/jobs/99999999999999999999",
        "/v1/jobs/" + "9" * 5000,
        "//evil.example/%2f..",
        "/v1/files/" + "0" * 64 + "/content",
        "/v1/files/%ff%fe/view",
    ):
        response = live.get(path)
        assert status_of(response) in {400, 404, 200}, (path, response[:200])
        assert b"root:" not in response
        assert b"location:" not in response.lower()


ATTACKS = (
    send_a_head_slowly,
    send_no_head,
    begin_a_second_head,
    send_a_head_without_an_end,
    send_trailers_without_an_end,
    send_a_body_slowly,
    stop_in_an_upload,
    announce_5_gb,
    send_more_than_announced,
    confuse_lengths,
    send_100_000_parts,
    send_too_much_without_a_length,
    go_on_after_the_answer,
    split_headers,
    forge_the_host,
    open_a_socket_from_another_page,
    send_large_frames,
    guess_keys,
    open_many_connections,
    read_nothing,
    ask_for_odd_paths,
)


def test_attacks_are_rejected_and_the_print_is_exact(
    live: LiveServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receiving.receive_upload, "__kwdefaults__", {"most": 6 << 20})
    job = add_job(live.queue, PRINT)
    with supervise(live.queue):
        until(lambda: live.queue.find_job(job).state == "printing")
        failed = {attack.__name__: error for attack in ATTACKS if (error := attempt(attack, live))}
        assert not failed
        until(lambda: live.queue.find_job(job).state != "printing")
    assert live.queue.find_job(job).state == "done", live.queue.find_job(job)
    (run,) = live.queue.list_runs(job)
    facts = json.loads((live.queue.find_run_folder(run.id) / "simulation.json").read_text())
    assert (facts["executed"], facts["unexpected"]) == (N_MOVES + BEGINNING.count(b"\n"), 0)


def attempt(attack: Callable[[LiveServer], None], live: LiveServer) -> str:
    """Attack the server, which answers others afterwards; return what went wrong."""
    try:
        attack(live)
        assert status_of(live.get("/v1/me")) == 200
    except (AssertionError, OSError, pytest.fail.Exception) as error:
        return repr(error)[:500]
    return ""


@pytest.mark.parametrize(("proxy", "is_secure"), [("", False), ("127.0.0.1", True), ("10.0.0.1", False)])
def test_cookies_are_for_tls_only_behind_a_proxy_with_tls(
    tmp_path: Path, proxy: str, is_secure: bool
) -> None:
    with run_live_server(tmp_path, Listener(proxy=proxy)) as server:
        token = server.access.create_link_token()
        response = server.get(f"/sign-in?token={token}", "X-Forwarded-Proto: https", key="")
        assert status_of(response) == 303
        assert (b"; secure" in response.lower()) is is_secure
