"""Previews of stored files, and the table of their layers."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.jobs import split_sendable
from printer_slicer.preview import decode_preview
from printer_slicer.print_queue import PrintQueue
from tests.server.client import GCODE, ServerClient, form

LAYERS = b"G28\nM104 S200 ; wait\n\n" + b"".join(
    b";LAYER_CHANGE\nG1 Z%.1f F600\nG1 X20 Y20 F6000\nG1 X60 E%d F1200\nM117 layer\nG1 Y60 E%d\n"
    % (0.2 * (layer + 1), 4 * layer + 2, 4 * layer + 4)
    for layer in range(5)
)


def test_the_preview_and_its_layers_are_those_of_the_file(server: ServerClient) -> None:
    stored, _ = server.post("/v1/files", **form(("file", "part.gcode", LAYERS))).json()
    answer = server.get(f"/v1/files/{stored['id']}/preview")
    assert answer.headers["content-encoding"] == "gzip"
    preview = decode_preview(answer.content)
    layers = server.get(f"/v1/files/{stored['id']}/layers").json()
    assert layers["first"] == preview.first.tolist()
    assert np.allclose(layers["z"], [0.2, 0.4, 0.6, 0.8, 1.0])
    assert np.allclose(layers["seconds"], preview.layer_seconds)
    commands = split_sendable("part.gcode", LAYERS).commands
    assert [commands[index] for index in layers["command"][1:]] == [
        b"G1 Z%.1f F600" % z for z in (0.4, 0.6, 0.8, 1.0)
    ]


def test_a_file_that_cannot_be_shown_says_so(server: ServerClient) -> None:
    stored, _ = server.post("/v1/files", **form(("file", "x.gcode", b"G28\n"))).json()
    for what in ("preview", "layers"):
        answer = server.get(f"/v1/files/{stored['id']}/{what}")
        assert answer.status_code == 422, answer.text
        assert answer.json()["remedy"]
        assert server.get(f"/v1/files/{'0' * 64}/{what}").status_code in {404, 422}


def test_previews_need_a_key(server: ServerClient) -> None:
    stored, _ = server.post("/v1/files", **form(("file", "part.gcode", GCODE))).json()
    del server.headers["x-api-key"]
    for what in ("preview", "layers"):
        assert server.get(f"/v1/files/{stored['id']}/{what}").status_code == 401


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_an_interrupted_reading_says_nothing_about_the_file(
    server: ServerClient, queue: PrintQueue, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "killed"
    program.write_text("#!/bin/sh\nkill -9 $$\n")
    program.chmod(0o700)
    with monkeypatch.context() as patch:
        patch.setattr(sys, "executable", str(program))
        answer = server.post("/v1/files", **form(("file", "part.gcode", GCODE)))
    assert (answer.status_code, "interrupted" in answer.text) == (422, True)
    (file,) = queue.list_files()
    assert queue.read_facts(file.id) is None
    assert server.get(f"/v1/files/{file.id}").json()[1]["problem"] == ""
