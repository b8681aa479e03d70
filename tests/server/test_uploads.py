"""Uploads: as slicers send them, broken ones, and hostile ones."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.problems import ProblemError
from printer_slicer.server.uploads import FormReader
from tests.server.client import GCODE, ServerClient, form

FILE = ("file", "part.gcode", GCODE)


def test_prusa_slicer_asks_for_the_version_and_then_sends_the_file(server: ServerClient) -> None:
    version = server.get("/api/version", headers={"x-api-key": server.headers["x-api-key"]}, params={}).json()
    assert version["text"].startswith("OctoPrint")
    assert version["api"]
    sent = form(("print", None, b"false"), ("path", None, b""), FILE, boundary="------------------------1f")
    answer = server.post("/printers/left/api/files/local", **sent)
    assert answer.status_code == 201
    assert answer.json()["files"]["local"]["name"] == "part.gcode"
    assert answer.json()["done"] is True


def test_cura_sends_select_and_print_behind_the_file(server: ServerClient, queue: PrintQueue) -> None:
    sent = form(("path", None, b"folder"), FILE, ("select", None, b"true"), ("print", None, b"true"))
    answer = server.post("/printers/left/api/files/local", **sent)
    assert answer.status_code == 201
    assert "/api/" in answer.headers["location"]
    assert answer.json()["effectivePrint"] is False
    (job,) = queue.snapshot().jobs
    assert (job.name, job.printer, job.state) == ("part.gcode", "left", "ready")
    assert "bed" in server.get(f"/v1/jobs/{job.id}/explanation").text


def test_moonraker_names_its_version_first(server: ServerClient, queue: PrintQueue) -> None:
    info = server.get("/printers/left/server/info")
    assert info.text.startswith('{"result":{')
    assert "moonraker_version" in info.json()["result"]
    sent = form(("root", None, b"gcodes"), ("path", None, b""), ("print", None, b"true"), FILE)
    answer = server.post("/printers/left/server/files/upload", **sent)
    assert answer.status_code == 201
    assert answer.json()["item"]["path"] == "part.gcode"
    assert answer.json()["print_started"] is False
    assert len(queue.snapshot().jobs) == 1


@pytest.mark.parametrize("name", ["file.path", "file.name", "FILE.PATH", "file.content_type", "path", "root"])
def test_fields_that_name_a_path_have_no_meaning(
    server: ServerClient, queue: PrintQueue, tmp_path: Path, name: str
) -> None:
    secret = tmp_path / "secret.txt"
    secret.write_text("secret")
    evil = (name, None, str(secret).encode())
    answer = server.post(
        "/api/files/local", params={name: str(secret), "printer": "left"}, **form(evil, FILE, evil)
    )
    assert answer.status_code == 404  # there are two printers
    answer = server.post(
        "/printers/left/api/files/local", params={name: str(secret)}, **form(evil, FILE, evil)
    )
    assert answer.status_code == 201
    assert secret.read_text() == "secret"
    (file,) = queue.list_files()
    assert queue.files.find_path(file.id).read_bytes() == GCODE


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("../../etc/passwd.gcode", 201),
        ("..\\\\..\\\\a.gcode", 201),
        ("/abs.gcode", 201),
        ("<img src=x onerror=alert(1)>.gcode", 201),
        ("\u202egpj.gcode", 201),
        ("a" * 300 + ".gcode", 201),
        ("a.html", 415),
        ("a.svg", 415),
        ("a.gcode.py", 415),
        ("a.bgcode", 415),
        ("a.ufp", 415),
        (".gcode.", 415),
    ],
)
def test_names_are_never_paths(
    server: ServerClient, queue: PrintQueue, tmp_path: Path, name: str, status: int
) -> None:
    before = {path for path in tmp_path.rglob("*") if "queue" not in path.parts}
    answer = server.post("/printers/left/api/files/local", **form(("file", name, GCODE)))
    assert answer.status_code == status
    assert {path for path in tmp_path.rglob("*") if "queue" not in path.parts} == before
    for file in queue.list_files():
        assert not set(file.name) & set("/\\\x00\u202e")
        assert len(file.name) <= 200


@pytest.mark.parametrize(
    ("parts", "status"),
    [
        ((("print", None, b"true"),), 400),
        ((FILE, ("file", "b.gcode", GCODE)), 400),
        ((("a", None, b"1" * 5000), FILE), 400),
        (tuple((f"f{n}", None, b"1") for n in range(30)), 400),
        ((("a" * 6000, None, b"1"), FILE), 400),
    ],
)
def test_forms_that_break_limits_are_rejected_and_leave_nothing(
    server: ServerClient, queue: PrintQueue, parts: tuple[tuple[str, str | None, bytes], ...], status: int
) -> None:
    answer = server.post("/printers/left/api/files/local", **form(*parts))
    assert answer.status_code == status
    assert answer.headers["content-type"].startswith("text/plain")
    assert not queue.list_files()
    assert not list((queue.folder / "files").rglob("incoming/*"))


def test_an_upload_that_ends_early_is_rejected(server: ServerClient, queue: PrintQueue) -> None:
    sent = form(FILE)
    sent["content"] = sent["content"][:-12]
    assert server.post("/printers/left/api/files/local", **sent).status_code == 400
    assert not queue.list_files()


def test_a_length_above_the_limit_is_rejected_before_the_body(server: ServerClient) -> None:
    sent = form(FILE)
    sent["headers"]["content-length"] = str(1 << 40)
    assert server.post("/printers/left/api/files/local", **sent).status_code == 413


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=3000), st.lists(st.integers(1, 400), min_size=1, max_size=20))
def test_any_content_arrives_in_any_pieces(content: bytes, sizes: list[int]) -> None:
    sent = form(("before", None, b"1"), ("file", "a b.gcode", content), ("after", None, b"2"), boundary="zzz")
    body, chunks = sent["content"], []
    while body:
        size = sizes[len(chunks) % len(sizes)]
        chunks.append(body[:size])
        body = body[size:]
    chunks.append(b"")
    rest = iter(chunks)
    reader = FormReader(sent["headers"]["content-type"], lambda: next(rest))
    assert reader.find_file() == "a b.gcode"
    assert b"".join(reader.read_file()) == content
    assert reader.fields == {"before": "1", "after": "2"}


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=500))
def test_any_bytes_are_a_form_or_a_problem(body: bytes) -> None:
    chunks = iter([body, b""])
    reader = FormReader("multipart/form-data; boundary=b", lambda: next(chunks))
    with pytest.raises(ProblemError):
        _read_whole(reader)


def _read_whole(reader: FormReader) -> bytes:
    reader.find_file()
    return b"".join(reader.read_file())


def test_a_file_is_saved_by_browsers_and_shown_by_the_viewer(server: ServerClient) -> None:
    name = 'a"b\\r\\nset-cookie: x=1 <script>.gcode'
    (file, _) = server.post("/v1/files", **form(("file", name.replace('"', ""), GCODE))).json()
    saved = server.get(f"/v1/files/{file['id']}/content")
    assert saved.content == GCODE
    assert saved.headers["content-type"] == "application/octet-stream"
    assert saved.headers["content-disposition"].startswith("attachment")
    assert "set-cookie" not in saved.headers
    shown = server.get(f"/v1/files/{file['id']}/view")
    assert shown.status_code == 200, shown.text
    assert "sha256-" in shown.headers["content-security-policy"]
    assert "<script>.gcode" not in shown.text
    assert server.get(f"/v1/files/{'0' * 64}/view").status_code == 404
    assert server.get("/v1/files/..%2f..%2faccess.db/content").status_code == 404


def test_a_file_is_deleted_when_no_job_needs_it(server: ServerClient, queue: PrintQueue) -> None:
    file, _ = server.post("/v1/files", **form(("file", "part.gcode", GCODE))).json()
    address = f"/v1/files/{file['id']}"
    (job,) = server.post("/v1/jobs", json={"file": file["id"]}).json()
    assert server.get(f"{address}/layers").status_code == 200
    refused = server.delete(address)
    assert refused.status_code >= 400
    assert f"job {job['id']} needs part.gcode" in refused.json()["detail"]
    queue.cancel_job(job["id"])
    assert server.delete(address).status_code == 204
    assert server.get("/v1/files").json() == []
    assert server.get(f"{address}/content").status_code == 404
    assert server.get(f"/v1/jobs/{job['id']}").json()["file"] == file
    assert not list((queue.folder / "pages").iterdir())


@pytest.mark.parametrize("name", ["part.stl", "page.html", "part.bgcode", "part.ufp", "part"])
def test_only_files_with_a_name_of_gcode_are_stored(server: ServerClient, name: str) -> None:
    answer = server.post("/v1/files", **form(("file", name, GCODE)))
    assert answer.status_code == 415
    assert "plain G-code" in answer.json()["detail"]
    assert server.get("/v1/files").json() == []
