"""Pictures of webcams: only their hosts are added to the policy of the page."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.printers import parse_printers
from printer_slicer.server.guard import make_page_policy
from tests.server.client import ServerClient

PRINTER = {"port": "sim:", "profile": "marlin_220"}


def get_image_sources(server: ServerClient, address: str) -> str:
    policy = server.get(address).headers["content-security-policy"]
    return next(one for one in policy.split("; ") if one.startswith("img-src"))


def test_the_page_may_show_pictures_of_configured_hosts_only(server: ServerClient, tmp_path: Path) -> None:
    assert get_image_sources(server, "/") == "img-src 'self' data: blob:"
    file = tmp_path / "printers.toml"
    file.write_text(
        file.read_text() + 'webcam = "http://cam.local:8080/?action=stream"\nwebcam_interval = 5\n'
    )
    assert get_image_sources(server, "/") == "img-src 'self' data: blob: http://cam.local:8080"
    assert get_image_sources(server, "/v1/queue") == "img-src 'self' data: blob:"
    printer = server.get("/v1/printers").json()[1]
    assert printer["webcam"] == "http://cam.local:8080/?action=stream"
    assert printer["webcam_interval"] == 5
    told = server.get("/printers/right/api/settings").json()["webcam"]
    assert told == {"webcamEnabled": True, "streamUrl": "", "snapshotUrl": printer["webcam"]}
    assert server.get("/printers/left/api/settings").json()["webcam"]["webcamEnabled"] is False


def test_several_printers_may_share_a_host() -> None:
    policy = make_page_policy(["http://a.example/1", "http://a.example/2", "https://b.example:8443/"])
    assert "img-src 'self' data: blob: http://a.example https://b.example:8443;" in policy
    assert policy.count("default-src 'none'") == 1


@pytest.mark.parametrize(
    "webcam",
    [
        "javascript:alert(1)",
        "cam.local",
        "ftp://cam.local/",
        "http://",
        "http://a.example; script-src *",
        "http://*/",
        "http://u:p@cam.local/",
        "http://cam.local/ 'unsafe-inline'",
        "http://cam.local/\n",
    ],
)
def test_what_is_no_address_of_a_picture_is_rejected(webcam: str) -> None:
    with pytest.raises(UsageError, match="webcam"):
        parse_printers({"left": {**PRINTER, "webcam": webcam}})
