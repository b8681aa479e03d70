"""`check`: what is said, what is written, and how it ends."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.drawing import draw_coverage
from printer_slicer.drawing.canvas import Box, Line, Text, estimate_text_width
from printer_slicer.input_files import MODEL_SUFFIXES
from printer_slicer.inspection.coverage.limits import CoverageLimits, find_nearest_to_limit
from printer_slicer.mesh_io import export_stl
from tests.cli.command_line import BOX, QUICK, is_message, typed
from tests.parts import box


@pytest.fixture(scope="module")
def gcode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("check") / "box.gcode"
    assert typed("slice", BOX, "-o", path, "--planner", "uniform", *QUICK).code == 0
    return path


@pytest.fixture(scope="module")
def faulty(gcode: Path) -> Path:
    """The same without its outer perimeters from the third to the fifth layer."""
    kept, layer, outer = [], 0, False
    for line in gcode.read_text().splitlines():
        layer += line == ";LAYER_CHANGE"
        outer = line == ";TYPE:External perimeter" if line.startswith(";TYPE") else outer
        gone = outer and 3 <= layer <= 5 and line.startswith("G1") and "X" in line + "Y"
        kept.append(line.partition(" E")[0] if gone else line)
    path = gcode.with_name("faulty.gcode")
    path.write_text("\n".join(kept))
    return path


def test_a_file_that_is_right_passes(gcode: Path) -> None:
    done = typed("check", gcode, "--model", BOX)

    assert done.code == 0
    machine, first = done.out.splitlines()[:2]
    assert (
        machine
        == "printer marlin_220 (from the file), material pla (from the file), quality standard (from the file)"
    )
    assert first == "box.gcode against box.stl: within all limits"
    assert "material in shell" in done.out
    assert "x +110.000 y +110.000 z +0.000" in done.out
    assert done.err == ""


def test_a_file_that_is_wrong_does_not(faulty: Path) -> None:
    done = typed("check", faulty, "--model", BOX)

    assert done.code == 7
    assert "layers 3 to 5" in done.out
    assert "of the shell are not covered" in done.out
    assert is_message(done, "faulty.gcode", "layers 3 to 5", "more")


def test_json_tells_all(faulty: Path) -> None:
    done = typed("check", faulty, "--model", BOX, "--json", "--shell", "0.8")
    facts = json.loads(done.out)

    assert done.code == 7
    assert facts["ok"] is False
    assert facts["matched"] is True
    assert facts["shift"] == pytest.approx([110, 110, 0], abs=0.01)
    assert facts["shell_depth"] == 0.8
    assert facts["rules"]["shell"] == 0.8
    assert {len(column) for column in facts["layers"].values()} == {len(facts["layers"]["top"])}
    uncovered = [one for one in facts["findings"] if one["kind"] == "uncovered"]
    assert [(one["first"], one["last"]) for one in uncovered] == [(3, 5)]
    assert facts["models"][0]["file"] == str(BOX)
    assert facts["volume_by_role"]["Skirt/Brim"] > 0


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_a_picture_shows_the_worst_layers(faulty: Path, tmp_path: Path, kind: str) -> None:
    picture = tmp_path / f"faults.{kind}"

    assert typed("check", faulty, "--model", BOX, "--picture", picture, "--quiet").code == 7
    data = picture.read_bytes()
    if kind == "svg":
        names = {element.get("class") for element in ET.fromstring(data).iter()}
        assert {"bead", "section", "uncovered", "frame", "close-up"} <= names
        assert b"faulty.gcode against box.stl" in data
    else:
        assert data.startswith(b"\x89PNG")


def test_a_picture_without_findings_shows_the_layer_nearest_to_a_limit(gcode: Path, tmp_path: Path) -> None:
    picture = tmp_path / "nothing.svg"

    done = typed("check", gcode, "--model", BOX, "--picture", picture)
    elements = list(ET.fromstring(picture.read_text()).iter())
    text = " ".join(element.text or "" for element in elements)
    nearest = r"nearest to a limit: layer \d+, z [\d.]+ mm, [a-z]+ at \d\d?% of its limit"
    assert done.code == 0
    assert re.search(f"no findings; {nearest}: ", text)
    assert re.search(f"(?m)^picture +{re.escape(str(picture))}: {nearest}$", done.out)
    assert "bead" in {element.get("class") for element in elements}


def test_the_nearest_limit_is_that_of_the_measure_that_uses_most_of_it(gcode: Path) -> None:
    coverage = ps.check_gcode(gcode.read_bytes(), ps.load_mesh(BOX)).coverage
    usual, share = find_nearest_to_limit(coverage)
    most = float(coverage.outline.p95.max())
    nearest, high = find_nearest_to_limit(coverage, CoverageLimits(outline=most / 0.99))

    assert 0 < share < 0.99
    assert 1 <= usual.layer <= coverage.stack.n_layers
    assert (nearest.code, nearest.layer) == ("outline", int(coverage.outline.p95.argmax()) + 1)
    assert high == pytest.approx(0.99)


def test_the_close_up_of_a_corner_stays_within_the_layer(gcode: Path) -> None:
    coverage = ps.check_gcode(gcode.read_bytes(), ps.load_mesh(BOX)).coverage
    corner = coverage.sections.rings(0)
    x, y = np.concatenate(list(corner)).max(axis=0).tolist()
    finding = Diagnostic("outside", "error", "a corner " * 40, layer=1, z=0.2, place=(x, y))
    picture = draw_coverage(coverage, [finding], "title", CoverageLimits())
    (frame,) = [one.points for one in picture.shapes if isinstance(one, Line) and one.name == "close-up"]
    whole = next(one for one in reversed(picture.shapes) if isinstance(one, Box) and one.name == "panel")
    heading = [one for one in picture.shapes if isinstance(one, Text) and "a corner" in one.text]

    assert (frame >= (whole.x - 0.01, whole.y - 0.01)).all()
    assert (frame <= (whole.x + whole.width + 0.01, whole.y + whole.height + 0.01)).all()
    assert len(heading) == 2
    assert all(one.y < whole.y for one in heading)


def test_a_picture_without_close_ups_is_narrow_and_its_legend_fits(gcode: Path) -> None:
    coverage = ps.check_gcode(gcode.read_bytes(), ps.load_mesh(BOX)).coverage
    wide, narrow = (
        draw_coverage(
            coverage,
            [Diagnostic("outline", "error", "m", layer=3, z=0.6, place=place)],
            "title",
            CoverageLimits(),
        )
        for place in ((0.0, 0.0), None)
    )
    texts = [one for one in narrow.shapes if isinstance(one, Text)]

    assert narrow.width < 0.7 * wide.width
    assert "outside" in {one.text for one in texts}
    assert all(one.x + estimate_text_width(one.text, one.size) < narrow.width for one in texts)


def test_json_and_a_picture_cannot_both_go_to_stdout(gcode: Path) -> None:
    done = typed("check", gcode, "--model", BOX, "--json", "--picture", "-")

    assert done.code == 2
    assert is_message(done, "cannot both go to stdout")


@pytest.mark.parametrize("limit", ["under=101%", "under=1.01"])
def test_limits_can_be_changed(gcode: Path, limit: str) -> None:
    assert typed("check", gcode, "--model", BOX, "--limit", limit).code == 7


@pytest.mark.parametrize("limit", ["under", "under=", "under=much", "undr=0.9", "under=-1", "under=nan"])
def test_limits_that_make_no_sense_are_refused(gcode: Path, limit: str) -> None:
    done = typed("check", gcode, "--model", BOX, "--limit", limit)

    assert done.code == 2
    assert is_message(done, limit, "outline")


def test_the_model_may_be_turned_and_scaled_as_it_was_sliced(tmp_path: Path) -> None:
    gcode, model = tmp_path / "wall.gcode", tmp_path / "wall.stl"
    export_stl(box((20.0, 8.0, 4.0)), model)
    changes = ["--rotate", "30", "--scale", "80%"]
    assert typed("slice", model, "-o", gcode, *changes, "--planner", "uniform", *QUICK).code == 0

    assert typed("check", gcode, "--model", model, *changes).code == 0
    assert typed("check", gcode, "--model", model).code == 7


def test_several_models_lie_as_their_files_place_them(tmp_path: Path) -> None:
    plate, other = tmp_path / "plate.gcode", tmp_path / "other.stl"
    export_stl(box((9.0, 6.0, 4.0), at=(40.0, 5.0, 0.0)), other)
    assert typed("slice", BOX, other, "-o", plate, "--planner", "uniform", *QUICK).code == 0

    assert typed("check", plate, "--model", BOX, other).code == 0
    one = typed("check", plate, "--model", BOX)
    assert one.code == 7
    assert "outside the outline" in one.out


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    missing = typed("check", tmp_path / "none.gcode", "--model", BOX)
    empty = tmp_path / "empty.gcode"
    empty.write_text("G28\n")

    assert missing.code == 2
    assert is_message(missing, "none.gcode", "no such file")
    nothing = typed("check", empty, "--model", BOX)
    assert nothing.code == 2
    assert is_message(nothing, "empty.gcode", "no extrusion of a part")
    assert typed("check", empty).code == 0  # without a model only what it holds is looked at


# What is no G-code


OTHER = {
    "part.stl": "solid\nfacet normal 0 0 0\nouter loop\n"
    + 3 * "vertex 0 8 0\n"
    + "endloop\nendfacet\nendsolid\n",
    "part.obj": "v 0 0 0\nv 1 2 3\nv 1 2 4\nf 1 2 3\n",
    "notes.txt": "print this part twice\nthe second time in red\n",
    "settings.toml": 'inherits = "standard"\nname = "mine"\n',
    "page.html": "<html>\n<body>\nG1\n</body>\n</html>\n",
}


@pytest.mark.parametrize("name", OTHER)
@pytest.mark.parametrize("more", [[], ["--json"], ["--model", BOX]])
def test_what_is_no_gcode_is_refused(name: str, more: list[object], tmp_path: Path) -> None:
    (tmp_path / name).write_text(OTHER[name])
    outcome = typed("check", name, *more, cwd=tmp_path)

    assert (outcome.code, outcome.out) == (2, "")
    reason = "but a model" if Path(name).suffix in MODEL_SUFFIXES else "such as"
    assert is_message(outcome, f"{name}: not a G-code file", reason, "printer-slicer slice")


def test_binary_gcode_is_named_so(tmp_path: Path) -> None:
    (tmp_path / "a.gcode").write_bytes(b"GCDE\x01\x00")

    assert is_message(typed("check", tmp_path / "a.gcode"), "a.gcode: this is binary G-code", "convert it")


def test_a_mesh_in_binary_is_no_gcode() -> None:
    assert is_message(
        typed("check", BOX),
        "box.stl: not a G-code file, but a model",
        f"Slice it first: printer-slicer slice {BOX}",
    )


ODD = {
    "macros": "START_PRINT BED=60 EXTRUDER=200\nPRINT_PART\nend_print\nset_fan_speed fan=a speed=1\n",
    "numbered": "N1 G28*18\nN2 G1X5Y5*33\nn3 g1 x6\n",
    "modal": "%\nO1000\n(a comment)\nG1 X5 Y5 F300\nX6\nY6\nM30\n%\n",
    "spoken": "M117 hello world\n@pause\nM118 E1 done\nT0\n",
    "comments": "; only\n; these\n; and\n; one\nG28\n",
}


@pytest.mark.parametrize("name", ODD)
def test_odd_gcode_is_gcode(name: str, tmp_path: Path) -> None:
    (tmp_path / "odd.gcode").write_text(ODD[name])

    assert "not a G-code file" not in typed("check", "odd.gcode", cwd=tmp_path).err
