"""`view`: what is written and said, and how it ends."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
from pathlib import Path

import pytest

from printer_slicer.preview import Preview, decode_preview
from tests.cli.command_line import BOX, QUICK, is_message, typed


@pytest.fixture(scope="module")
def sliced(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("view") / "box.gcode"
    assert typed("slice", BOX, "-o", path, "--planner", "uniform", *QUICK).code == 0
    return path


@pytest.fixture
def gcode(sliced: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(sliced, tmp_path / "box.gcode"))


def preview_in(page: Path) -> Preview:
    found = re.search(r'id="preview">([^<]*)<', page.read_text("utf-8"))
    assert found is not None
    return decode_preview(gzip.decompress(base64.b64decode(found[1])))


def test_the_page_is_written_beside_the_gcode(gcode: Path) -> None:
    done = typed("view", gcode)
    page = gcode.with_suffix(".html")
    preview = preview_in(page)
    assert (done.code, done.err) == (0, "")
    told = f"{page}: {preview.n_layers} layers, {preview.n_moves} moves, "
    assert done.out.startswith(told)
    assert done.out.rstrip().endswith(f" of motion, {page.stat().st_size / 1000:.0f} kB")
    assert preview.name == "box.gcode"


def test_json_tells_the_figures(gcode: Path, tmp_path: Path) -> None:
    page = tmp_path / "other.html"
    facts = json.loads(typed("view", gcode, "-o", page, "--json").out)
    preview = preview_in(page)
    assert facts["output"] == str(page)
    assert facts["bytes"] == page.stat().st_size
    assert facts["layers"] == preview.n_layers == 34
    assert facts["moves"] == preview.n_moves
    assert facts["seconds"] == pytest.approx(preview.layer_seconds.sum(), abs=0.5)
    assert "External perimeter" in facts["roles"]


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        (["-o", "page.png"], "the page is HTML"),
        (["-o", "missing/page.html"], "missing"),
        (["-o", "-", "--json"], "cannot both go to stdout"),
    ],
)
def test_outputs_that_cannot_be_are_rejected_before_work_starts(
    gcode: Path, options: list[str], wrong: str
) -> None:
    done = typed("view", gcode, *options)
    assert done.code == 2 or wrong == "missing"
    assert done.code != 0
    assert is_message(done)
    assert wrong in done.err
    assert not gcode.with_suffix(".html").exists()


def test_the_gcode_is_not_overwritten(gcode: Path) -> None:
    own = gcode.with_suffix(".html")
    gcode.rename(own)
    before = own.read_bytes()
    assert typed("view", own).code == 2
    assert own.read_bytes() == before


def test_models_and_files_without_extrusions_are_rejected(tmp_path: Path) -> None:
    empty = tmp_path / "empty.gcode"
    empty.write_text("G28\nG1 X10\n")
    for path in (Path(BOX), empty):
        done = typed("view", path, "-o", tmp_path / "page.html")
        assert done.code == 2
        assert is_message(done)
        assert not (tmp_path / "page.html").exists()
