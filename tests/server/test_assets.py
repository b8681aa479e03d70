"""The files of the page: their size, their headers, and what must not be in them."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

from printer_slicer.input_files import GCODE_SUFFIXES, MODEL_SUFFIXES
from printer_slicer.print_queue import PrintQueue
from printer_slicer.server.assets import Asset, load_assets
from tests.server.client import GCODE, ServerClient, form

MAX_BYTES = 90_000
FOLDER = files("printer_slicer.server").joinpath("page")
MODULES = sorted(one.name for one in FOLDER.iterdir() if one.name.endswith(".js"))


@pytest.fixture
def visitor(server: ServerClient) -> ServerClient:
    """A browser without a session."""
    del server.headers["x-api-key"]
    return server


def test_the_page_is_small(visitor: ServerClient) -> None:
    assets = load_assets()
    assert len(assets) == 3
    assert sum(len(asset.content) for asset in assets.values()) <= MAX_BYTES
    for address in assets:
        assert visitor.get(address).status_code == 200


def test_the_addresses_in_the_page_exist(visitor: ServerClient) -> None:
    page = visitor.get("/").text
    assert set(re.findall(r'(?:src|href)="(/[^"]*)"', page)) == set(load_assets()) - {"/"}


def test_the_page_offers_the_files_that_the_server_takes(visitor: ServerClient) -> None:
    page = visitor.get("/").text
    assert f'data-models="{",".join(MODEL_SUFFIXES)}" data-gcode="{",".join(GCODE_SUFFIXES)}"' in page


@pytest.mark.parametrize("address", sorted(load_assets()))
def test_files_are_compressed_once_and_not_sent_again(visitor: ServerClient, address: str) -> None:
    asset = load_assets()[address]
    plain = visitor.get(address, headers={"accept-encoding": "identity"})
    packed = visitor.get(address, headers={"accept-encoding": "gzip, br"})
    assert plain.content == packed.content == asset.content
    assert "content-encoding" not in plain.headers
    assert packed.headers["content-encoding"] == "gzip"
    assert plain.headers["content-type"] == packed.headers["content-type"] == asset.kind
    again = visitor.get(address, headers={"if-none-match": plain.headers["etag"]})
    assert again.status_code == 304
    assert not again.content
    assert ("immutable" in plain.headers["cache-control"]) == (address != "/")


@pytest.mark.parametrize("name", ["main.js", "..%2fapp.py", "%2e%2e/app.py", "page.html", "main.js%00", ""])
def test_only_files_of_the_page_are_served(visitor: ServerClient, name: str) -> None:
    assert visitor.get(f"/page/{name}").status_code == 404


def list_texts() -> list[tuple[str, Asset]]:
    return list(load_assets().items())


@pytest.mark.parametrize(("address", "asset"), list_texts(), ids=lambda value: str(value)[:6])
def test_nothing_is_inline_or_from_elsewhere(address: str, asset: Asset) -> None:
    text = asset.content.decode()
    outside = set(re.findall(r"(?:https?|wss?):?//[\w.]+", text)) - {"http://www.w3.org"}
    assert outside == set()
    assert not re.search(
        r"\b(?:innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval|Function)\b", text
    )
    if address == "/":
        assert not re.search(r"<style|\sstyle=|\son\w+=|<script(?![^>]*\ssrc=)", text)


@pytest.mark.parametrize("name", MODULES)
def test_modules_say_what_they_are_and_are_used(name: str) -> None:
    text = FOLDER.joinpath(name).read_text("utf-8")
    assert text.startswith("/**\n * ")
    assert "\t" not in text
    script = next(asset for address, asset in load_assets().items() if address.endswith(".js"))
    joined = script.content.decode()
    assert not re.search(r"^ */\*\*", joined, re.MULTILINE)
    for one in re.findall(r"^(?:export )?(?:async )?(?:function|const|class) (\w+)", text, re.MULTILINE):
        assert re.search(rf"^(?:async )?(?:function|const|class) {one}\b", joined, re.MULTILINE), one
    for names, _ in re.findall(r'^import \{ ([^}]*) \} from "\./([a-z_]+\.js)";$', text, re.MULTILINE):
        for one in names.split(", "):
            assert len(re.findall(rf"\b{one}\b", text)) > 1, f"{name} imports {one} and does not use it"


def test_the_page_reads_files_history_and_explanations_at_once(
    server: ServerClient, queue: PrintQueue
) -> None:
    stored, _ = server.post("/v1/files", **form(("file", "part.gcode", GCODE))).json()
    first, second = server.post("/v1/jobs", json={"file": stored["id"], "copies": 2}).json()
    ((file, facts),) = server.get("/v1/files").json()
    assert file == stored
    assert facts["problem"] == ""
    explained = server.get("/v1/explanations").json()
    assert [one["job"]["id"] for one in explained] == [first["id"], second["id"]]
    assert explained[0] == server.get(f"/v1/jobs/{first['id']}/explanation").json()
    queue.cancel_job(first["id"])
    ((job, run),) = server.get("/v1/history").json()
    assert (job["id"], job["state"], run) == (first["id"], "cancelled", None)
