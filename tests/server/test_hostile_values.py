"""Values that mean harm in requests that are otherwise valid."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.errors import OutputError
from printer_slicer.print_queue import PrintQueue, file_store
from printer_slicer.server.access import AccessStore
from tests.server.client import GCODE, ServerClient, form


def upload(server: ServerClient) -> str:
    (file, _) = server.post("/v1/files", **form(("file", "part.gcode", GCODE))).json()
    return str(file["id"])


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../secret.toml", "secret.toml", "a/b", "..\\a", "", "pla\x00", "\u202epla", ".."]
)
def test_a_name_of_a_profile_is_no_path(server: ServerClient, tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.toml").write_text("password = 'abc'")
    answer = server.put("/v1/printers/left/material", json={"material": name})
    assert answer.status_code == 422
    assert "TOML" not in answer.text
    sent = form(("printer", None, b"left"), ("quality", None, name.encode()), ("file", "a.stl", b"solid"))
    assert name == "" or server.post("/v1/slices", **sent).status_code == 422


@pytest.mark.parametrize("number", ["9" * 18, "9" * 20, "9" * 5000, "-1", "1e3", "%00"])
def test_a_number_that_no_job_has_is_not_found(server: ServerClient, number: str) -> None:
    assert server.get(f"/v1/jobs/{number}").status_code in {404, 422}
    assert server.delete(f"/v1/jobs/{number}").status_code in {404, 405, 422}


def test_numbers_that_the_database_cannot_hold_are_rejected(server: ServerClient, queue: PrintQueue) -> None:
    file = upload(server)
    (job,) = server.post("/v1/jobs", json={"file": file}).json()
    for number in (10**30, -(10**30), 1 << 63):
        assert server.put(f"/v1/jobs/{job['id']}/place", json={"before": number}).status_code == 422
        assert server.post("/v1/jobs", json={"file": file, "copies": number}).status_code == 422
    assert len(queue.snapshot().jobs) == 1


@pytest.mark.parametrize("start", [b"[", b'{"a":', b'{"file":[', b'{"command":{"a":'])
@pytest.mark.parametrize("path", ["/v1/jobs", "/v1/session", "/v1/keys", "/printers/left/api/job"])
def test_deep_json_is_rejected(server: ServerClient, path: str, start: bytes) -> None:
    assert server.post(path, content=start * 10_000).status_code in {400, 413}


@pytest.mark.parametrize(
    "body",
    [b"\xff\xfe", b'{"file": NaN}', b'{"file": "\\ud800"}', b"{", b'"', b"null", b'{"file": "x", "more": 1}'],
)
def test_invalid_json_is_rejected(server: ServerClient, body: bytes) -> None:
    assert server.post("/v1/jobs", content=body).status_code == 400


def test_huge_json_is_rejected(server: ServerClient) -> None:
    assert server.post("/v1/jobs", json={"file": "x" * 100_000}).status_code == 413


@pytest.mark.parametrize(
    ("wanted", "status", "content"),
    [
        ("bytes=0-2", 206, GCODE[:3]),
        ("bytes=-3", 206, GCODE[-3:]),
        ("bytes=3-", 206, GCODE[3:]),
        ("bytes=0-1,3-4", 200, GCODE),
        ("bytes=" + "0-," * 3000, 200, GCODE),
        ("bytes=--1", 200, GCODE),
        ("bytes=-" + "9" * 5000, 200, GCODE),
        ("lines=1-2", 200, GCODE),
        ("bytes=5-1", 400, None),
        ("bytes=999999-", 416, None),
    ],
)
def test_one_range_of_a_file_is_sent_and_several_are_ignored(
    server: ServerClient, queue: PrintQueue, wanted: str, status: int, content: bytes | None
) -> None:
    file = queue.add_file("part.gcode", [GCODE])
    answer = server.get(f"/v1/files/{file.id}/content", headers={"range": wanted})
    assert answer.status_code == status
    assert content is None or answer.content == content


def test_a_link_in_the_store_is_not_followed(server: ServerClient, queue: PrintQueue, tmp_path: Path) -> None:
    file = upload(server)
    secret = tmp_path / "secret"
    secret.write_text("secret")
    path = queue.files.find_path(file)
    path.unlink()
    path.symlink_to(secret)
    for what in ("content", "view"):
        answer = server.get(f"/v1/files/{file}/{what}")
        assert answer.status_code == 404
        assert answer.text.count("secret") == 0
    assert upload(server) == file
    assert secret.read_text() == "secret"
    assert server.get(f"/v1/files/{file}/content").content == GCODE


def test_uploads_leave_free_space(
    server: ServerClient, queue: PrintQueue, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(file_store, "_FREE_BYTES", 1 << 60)
    answer = server.post("/v1/files", **form(("file", "part.gcode", GCODE)))
    assert answer.status_code == 422
    assert "free" in answer.text
    assert not queue.list_files()


def test_a_session_that_an_attacker_chose_is_not_adopted(server: ServerClient, access: AccessStore) -> None:
    del server.headers["x-api-key"]
    chosen = "a" * 43
    server.cookies.set("printer_slicer_session", chosen)
    token = access.create_link_token()
    assert server.get("/sign-in", params={"token": token}, follow_redirects=False).status_code == 303
    assert access.find_session(chosen) is None


def test_errors_of_the_keys_do_not_speak_of_the_queue(tmp_path: Path) -> None:
    (tmp_path / "access.db").write_bytes(b"no database" * 999)
    with pytest.raises(OutputError, match="access keys"):
        AccessStore(tmp_path / "access.db")
