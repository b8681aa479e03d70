"""Keys, sessions, and requests that other sites make a browser send."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import time

import pytest
from starlette.websockets import WebSocketDisconnect

from printer_slicer.errors import UsageError
from printer_slicer.print_queue import JobRequest, PrintQueue
from printer_slicer.server.access import SCOPES, AccessStore
from printer_slicer.server.app import make_app
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.operations import SESSION_COOKIE
from printer_slicer.server.running import Listener
from printer_slicer.server.services import Services
from tests.server.client import GCODE, PAGE, ServerClient


def test_without_a_key_nothing_is_told(server: ServerClient) -> None:
    del server.headers["x-api-key"]
    for path in (
        "/v1/me",
        "/v1/queue",
        "/v1/files",
        "/api/version",
        "/api/printer",
        "/printers/left/api/job",
    ):
        answer = server.get(path)
        assert answer.status_code == 401, path
        assert "Create a key: printer-slicer serve --new-key NAME" in answer.text


@pytest.mark.parametrize("key", ["", "ps_", "ps_00000000_x", "x" * 5000, "ps_' OR 1=1_x", "ps_\udcff"])
def test_an_unknown_key_is_rejected(access: AccessStore, key: str) -> None:
    access.create_key("other", SCOPES)
    assert access.find_key(key) is None
    assert access.sign_in(key) is None


def test_only_the_hash_of_a_key_is_stored(access: AccessStore) -> None:
    _, text = access.create_key("slicer")
    rows = access._database.read("SELECT * FROM key")
    stored = b"".join(bytes(str(value), "utf-8") for row in rows for value in tuple(row))
    assert text.split("_")[2].encode() not in stored
    found = access.find_key(text)
    assert found is not None
    assert not found.allows("control")
    assert found.allows("print")


def test_a_key_of_one_printer_is_not_for_another(server: ServerClient, access: AccessStore) -> None:
    _, text = access.create_key("left", ["read", "upload", "print", "control"], "left")
    server.headers["x-api-key"] = text
    assert server.get("/api/printer").status_code == 200
    assert server.get("/printers/right/api/printer").status_code == 403
    assert server.put("/v1/printers/right/bed", json={"bed": "clear"}).status_code == 403
    assert server.put("/v1/printers/left/bed", json={"bed": "clear"}).status_code == 200
    assert server.get("/v1/keys").status_code == 403


def test_a_key_of_one_printer_changes_only_jobs_for_this_printer(
    server: ServerClient, access: AccessStore, queue: PrintQueue
) -> None:
    file = queue.add_file("part.gcode", [GCODE])
    jobs = [queue.add_jobs(file.id, JobRequest(printer=name))[0].id for name in ("", "right", "left")]
    _, text = access.create_key("left", ["read", "print"], "left")
    server.headers["x-api-key"] = text
    assert [server.delete(f"/v1/jobs/{job}").status_code for job in jobs] == [403, 403, 200]
    assert [queue.find_job(job).state for job in jobs] == ["ready", "ready", "cancelled"]


def test_signing_in_reads_no_long_body(server: ServerClient) -> None:
    del server.headers["x-api-key"]
    pieces = (b" " * 65536 for _ in range(100))  # without a length
    assert server.post("/v1/session", content=pieces).status_code == 413


def test_a_key_needs_a_name_and_known_scopes(access: AccessStore) -> None:
    for name, scopes in ((" ", ["read"]), ("a", []), ("a", ["root"])):
        with pytest.raises(UsageError):
            access.create_key(name, scopes)  # type: ignore[arg-type]


def sign_in(server: ServerClient, access: AccessStore) -> None:
    server.headers.pop("x-api-key", None)
    answer = server.get("/sign-in", params={"token": access.create_link_token()}, follow_redirects=False)
    assert answer.status_code == 303
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


def test_a_link_works_once(server: ServerClient, access: AccessStore) -> None:
    token = access.create_link_token()
    assert server.get("/sign-in", params={"token": token}, follow_redirects=False).status_code == 303
    server.cookies.clear()
    again = server.get("/sign-in", params={"token": token}, follow_redirects=False)
    assert again.headers["location"] == "/"
    assert "set-cookie" not in again.headers
    del server.headers["x-api-key"]
    assert server.get("/v1/me").status_code == 401


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"origin": "http://testserver"},
        {"x-printer-slicer": "1"},
        {"origin": "http://evil.example", "x-printer-slicer": "1"},
        {"origin": "null", "x-printer-slicer": "1"},
        {"sec-fetch-site": "cross-site", "x-printer-slicer": "1"},
        {"origin": "http://testserver.evil.example", "x-printer-slicer": "1"},
    ],
)
def test_another_site_changes_nothing_with_a_cookie(
    server: ServerClient, access: AccessStore, queue: PrintQueue, headers: dict[str, str]
) -> None:
    sign_in(server, access)
    answer = server.put("/v1/printers/left/bed", json={"bed": "clear"}, headers=headers)
    assert answer.status_code == 403
    assert queue.snapshot().printers[0].bed == "unknown"
    assert server.put("/v1/printers/left/bed", json={"bed": "clear"}, headers=PAGE).status_code == 200


@pytest.mark.parametrize("header", ["x-api-key", "authorization"])
def test_a_deleted_key_closes_its_socket(server: ServerClient, access: AccessStore, header: str) -> None:
    key, text = access.create_key("phone", frozenset({"read"}))
    del server.headers["x-api-key"]
    headers = {header: f"Bearer {text}" if header == "authorization" else text}
    with server.websocket_connect("/v1/feed", headers=headers) as feed:
        feed.receive_text()
        access.delete_key(key.id)
        with pytest.raises(WebSocketDisconnect):
            feed.receive_text()


def test_a_session_ends_with_its_key_and_closes_its_sockets(
    server: ServerClient, access: AccessStore
) -> None:
    key, text = access.create_key("sofa", SCOPES)
    del server.headers["x-api-key"]
    assert server.post("/v1/session", json={"key": text}).status_code == 204
    with server.websocket_connect("/v1/feed") as feed:
        feed.receive_text()
        access.delete_key(key.id)
        with pytest.raises(WebSocketDisconnect):
            feed.receive_text()
    assert server.get("/v1/me").status_code == 401


def test_after_signing_out_the_cookie_is_worthless(server: ServerClient, access: AccessStore) -> None:
    sign_in(server, access)
    cookie = server.cookies["printer_slicer_session"]
    assert server.delete("/v1/session", headers=PAGE).status_code == 204
    server.cookies.set("printer_slicer_session", cookie)
    assert server.get("/v1/me").status_code == 401


@pytest.mark.parametrize(
    "host", ["evil.example", "testserver.evil.example", "", "testserver@evil", "[::1", "a b"]
)
def test_an_unknown_host_is_rejected(server: ServerClient, host: str) -> None:
    assert server.get("/v1/me", headers={"host": host}).status_code == 421


def test_a_socket_of_another_site_is_closed(server: ServerClient, access: AccessStore) -> None:
    sign_in(server, access)
    with (
        pytest.raises(WebSocketDisconnect),
        server.websocket_connect("/v1/feed", headers={"origin": "http://evil.example"}),
    ):
        pass


def test_forwarded_headers_give_no_rights(server: ServerClient) -> None:
    del server.headers["x-api-key"]
    for name in ("x-forwarded-for", "x-real-ip", "forwarded", "x-remote-user", "remote-user"):
        assert server.get("/v1/me", headers={name: "127.0.0.1"}).status_code == 401


def test_too_many_headers_are_rejected(server: ServerClient) -> None:
    assert server.get("/v1/me", headers={f"x-{n}": "1" for n in range(120)}).status_code == 431
    assert server.get("/v1/me", headers={"x-long": "1" * 20_000}).status_code == 431


def test_answers_forbid_what_browsers_need_not_do(server: ServerClient) -> None:
    for path in ("/v1/me", "/v1/none", "/"):
        headers = server.get(path).headers
        assert headers["x-content-type-options"] == "nosniff"
        assert "frame-ancestors 'none'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]


def test_a_key_needs_a_printer_that_exists(server: ServerClient, access: AccessStore) -> None:
    answer = server.post("/v1/keys", json={"name": "x", "scopes": ["read"], "printer": "lft"})
    assert (answer.status_code, "no printer lft" in answer.text) == (422, True)
    assert [key.name for key in access.list_keys()] == ["tests"]


@pytest.mark.parametrize(
    ("listener", "url"),
    [
        (Listener(), "http://127.0.0.1:5000"),
        (Listener("0.0.0.0", hosts=("printbox.local",)), "http://printbox.local:5000"),
        (Listener("::"), "http://127.0.0.1:5000"),
        (Listener("::1", 80), "http://[::1]:80"),
    ],
)
def test_the_address_of_the_page_can_be_opened(listener: Listener, url: str) -> None:
    assert listener.url == url


def test_a_link_works_after_the_clock_was_set(
    server: ServerClient, access: AccessStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    del server.headers["x-api-key"]
    token = access.create_link_token()
    monkeypatch.setattr("printer_slicer.server.access.time", lambda: time() + 30 * 86400)
    assert server.get("/sign-in", params={"token": token}, follow_redirects=False).status_code == 303
    assert server.get("/v1/me").status_code == 200


@pytest.fixture
def shared(queue: PrintQueue, access: AccessStore, tmp_path: Path) -> Iterator[ServerClient]:
    """A server whose interface a page of another site may use."""
    _, key = access.create_key("farm", ["read", "control"])
    guard = GuardSettings(frozenset({"testserver"}), frozenset({"https://farm.example"}))
    with ServerClient(make_app(Services(queue, access, guard, tmp_path / "prints"))) as client:
        client.headers["x-api-key"] = key
        yield client


def test_a_page_of_a_named_origin_may_use_the_interface_with_a_key(shared: ServerClient) -> None:
    origin = {"origin": "https://farm.example"}
    asked = origin | {"access-control-request-method": "PUT", "access-control-request-headers": "x-api-key"}
    answer = shared.options("/v1/printers/left/bed", headers=asked)
    assert answer.status_code == 204
    assert answer.headers["access-control-allow-origin"] == "https://farm.example"
    assert "PUT" in answer.headers["access-control-allow-methods"]
    assert "x-api-key" in answer.headers["access-control-allow-headers"]
    assert "access-control-allow-credentials" not in answer.headers
    changed = shared.put("/v1/printers/left/bed", json={"bed": "clear"}, headers=origin)
    assert changed.status_code == 200
    assert changed.headers["access-control-allow-origin"] == "https://farm.example"
    assert "origin" in changed.headers["vary"]


@pytest.mark.parametrize(
    "origin", ["https://evil.example", "null", "http://farm.example", "https://farm.example.org"]
)
def test_no_other_page_may_read_a_response(shared: ServerClient, origin: str) -> None:
    for answer in (
        shared.options("/v1/queue", headers={"origin": origin, "access-control-request-method": "GET"}),
        shared.get("/v1/queue", headers={"origin": origin}),
    ):
        assert not [name for name in answer.headers if name.startswith("access-control")]


def test_a_page_of_a_named_origin_never_acts_with_a_session(
    shared: ServerClient, access: AccessStore
) -> None:
    del shared.headers["x-api-key"]
    secret = access.sign_in(access.create_link_token())
    assert secret is not None
    shared.cookies.set(SESSION_COOKIE, secret)
    headers = {"origin": "https://farm.example", "x-printer-slicer": "1"}
    assert shared.put("/v1/printers/left/bed", json={"bed": "clear"}, headers=headers).status_code == 403
    with pytest.raises(WebSocketDisconnect), shared.websocket_connect("/v1/feed", headers=headers):
        pass
