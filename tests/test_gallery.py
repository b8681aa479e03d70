"""The gallery: its parts are sound, its page tells the commands that make its pictures, and the pictures are there."""

from __future__ import annotations

import re
import shlex
from math import pi
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from benchmarks.gallery import ENTRIES, commands, write_part
from printer_slicer import cli
from printer_slicer.healing import repair
from printer_slicer.mesh_io import load_mesh

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
LARGEST = 150_000  # bytes of a picture


@pytest.mark.parametrize("name", ENTRIES)
def test_every_part_is_closed_stands_on_the_bed_and_needs_no_repair(name: str, tmp_path: Path) -> None:
    mesh = load_mesh(write_part(name, tmp_path / "parts"))
    mended, repairs = repair(mesh)

    assert repairs.done == ()
    assert mended.bounds[0, 2] == 0
    assert mesh.volume == pytest.approx(mended.volume)
    assert mesh.volume > 0


def test_parts_are_as_large_as_their_shapes_say() -> None:
    assert ENTRIES["wedge"].part().volume == pytest.approx(50 * 6 / 2 * 2)
    assert ENTRIES["dome"].part().volume == pytest.approx(2 / 3 * pi * 15**2 * 6, rel=2e-3)
    assert np.allclose(ENTRIES["lightning"].part().size, (40, 30, 20))


@pytest.mark.parametrize("name", ENTRIES)
def test_the_page_tells_the_very_commands_of_each_picture(name: str) -> None:
    block = "```sh\n" + "\n".join(commands(name)) + "\n```"

    assert f"](gallery/{name}.svg)\n\n{block}" in PAGE


def test_every_picture_of_the_page_is_one_of_the_gallery_and_small() -> None:
    shown = re.findall(r"\]\(gallery/(\w+)\.svg\)", PAGE)

    assert shown == list(ENTRIES)
    for name in shown:
        text = (ROOT / "docs" / "gallery" / f"{name}.svg").read_bytes()
        title = ET.fromstring(text).findtext("{http://www.w3.org/2000/svg}title") or ""
        assert len(text) < LARGEST
        assert title.startswith(f"{name}.gcode: layer {ENTRIES[name].layer} of ")


@pytest.mark.parametrize("name", ENTRIES)
def test_every_picture_is_the_one_its_commands_draw_today(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "docs" / "gallery").mkdir(parents=True)
    write_part(name, tmp_path / "gallery")

    for command in commands(name):
        assert cli.main([*shlex.split(command)[1:], "--quiet"]) == 0

    drawn = tmp_path / "docs" / "gallery" / f"{name}.svg"
    assert drawn.read_bytes() == (ROOT / "docs" / "gallery" / f"{name}.svg").read_bytes()
