"""`draw`: what is drawn and said, and how it ends."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tests.cli.command_line import BOX, PARTS, QUICK, is_message, typed
from tests.inspection.coverage.lines import path

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def gcode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("draw") / "box.gcode"
    assert typed("slice", BOX, "-o", path, "--planner", "uniform", *QUICK).code == 0
    return path


def texts(path: Path) -> list[str]:
    return [one.text or "" for one in ET.parse(path).getroot().iter(f"{SVG}text")]


def named(path: Path, name: str) -> list[ET.Element]:
    return [one for one in ET.parse(path).getroot().iter() if one.get("class") == name]


def test_a_layer_is_drawn_and_told(gcode: Path, tmp_path: Path) -> None:
    done = typed("draw", gcode, "--layer", 5, "-o", tmp_path / "layer.svg")
    first, *beads = done.out.splitlines()

    assert done.code == 0
    assert done.err == ""
    assert first == f"{tmp_path / 'layer.svg'}: layer 5 of 34, z 1.4 mm, 0.3 mm high"
    assert [line.partition(":")[0].strip() for line in beads] == [
        "Perimeter",
        "External perimeter",
        "Internal infill",
    ]
    assert texts(tmp_path / "layer.svg")[0] == "box.gcode: layer 5 of 34, z 1.4 mm, 0.3 mm high"
    assert named(tmp_path / "layer.svg", "external-perimeter") != []
    assert named(tmp_path / "layer.svg", "travel") == []


def test_a_height_picks_the_layer_that_holds_it(gcode: Path, tmp_path: Path) -> None:
    one, other = tmp_path / "one.svg", tmp_path / "other.svg"

    assert typed("draw", gcode, "--layer", 5, "-o", one).code == 0
    assert typed("draw", gcode, "--z", 1.33, "-o", other).code == 0
    assert one.read_bytes() == other.read_bytes()


def test_a_name_in_png_gives_a_png_as_large_as_asked(gcode: Path, tmp_path: Path) -> None:
    picture = tmp_path / "layer.png"

    assert typed("draw", gcode, "-o", picture, "--pixels", 700, "--travel", "-q") == (0, "", "")
    head = picture.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(head[16:20], "big") == 700 + 2 * 12


def test_json_tells_what_was_drawn(gcode: Path, tmp_path: Path) -> None:
    done = typed("draw", gcode, "--layer", 34, "-o", tmp_path / "a.svg", "--model", BOX, "--json")
    facts = json.loads(done.out)
    beads = {one["role"]: one for one in facts["extrusions"]}
    volume = sum(one["volume"] for one in facts["extrusions"])

    assert (facts["layer"], facts["layers"], facts["height"]) == (34, 34, 0.2)
    assert all(one["comment"] == one["role"] for one in facts["extrusions"])
    assert facts["fit"] > 0.99
    assert list(beads) == ["Perimeter", "External perimeter", "Top solid infill"]
    assert volume == pytest.approx(20 * 20 * 0.2, rel=0.03)
    assert beads["External perimeter"]["length"] == pytest.approx(4 * (20 - 0.45), rel=0.01)
    assert beads["External perimeter"]["width"] == pytest.approx([0.45, 0.45], abs=0.02)


def test_the_model_is_found_and_its_section_drawn(gcode: Path, tmp_path: Path) -> None:
    picture = tmp_path / "layer.svg"
    done = typed("draw", gcode, "--layer", 5, "--model", BOX, "-o", picture)
    (outline,) = named(picture, "outline")
    ends = [float(word) for word in outline.attrib["d"].replace("M", " ").replace("L", " ").split()]
    size = np.ptp(np.reshape(ends, (-1, 2)), axis=0)

    assert done.code == 0
    assert "Section without extrusion" in texts(picture)
    # The widest bead of the layer is as much beyond the walls' middle as is drawn of it.
    assert size == pytest.approx(np.full(2, 1000 * 20 / (20 + 2 * (1 + 0.45 / 2))), rel=3e-3)


def test_another_model_is_noticed(gcode: Path, tmp_path: Path) -> None:
    done = typed("draw", gcode, "--layer", 5, "--model", PARTS / "vase.stl", "-o", tmp_path / "a.svg")

    assert done.code == 0
    assert "check that the file was sliced from this model" in done.out


def test_a_box_may_begin_with_a_minus_sign(tmp_path: Path) -> None:
    file, picture = tmp_path / "a.gcode", tmp_path / "a.svg"
    file.write_text("\n".join(["M83", *path([(-9, -9), (9, -9), (9, 9)], 0.2, 0.2)]))

    assert typed("draw", file, "--box", "-10,-10,-5,-5", "-o", picture, "-q") == (0, "", "")
    assert len(named(picture, "edge")) == 1


def test_files_of_other_slicers_are_drawn_with_their_own_names(tmp_path: Path) -> None:
    file, picture = tmp_path / "cura.gcode", tmp_path / "a.svg"
    lines = [";LAYER:0", ";TYPE:WALL-OUTER", *path([(0, 0), (9, 0), (9, 9), (0, 9), (0, 0)], 0.3, 0.3)]
    lines += [";TYPE:SUPPORT-INTERFACE", *path([(20, 0), (29, 0)], 0.3, 0.3)]
    file.write_text("\n".join([";FLAVOR:Marlin", "M83", *lines]))

    assert typed("draw", file, "-o", picture, "-q").code == 0
    assert {"Wall-outer", "Support-interface"} < set(texts(picture))


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (["--layer", "0"], "box.gcode has layers 1 to 34"),
        (["--layer", "35"], "box.gcode has layers 1 to 34"),
        (["--z", "10.1"], "has layers from the bed to z 10 mm"),
        (["--box", "0,0,5,5"], "none of the extrusions of layer 1, which extend from"),
    ],
)
def test_what_is_not_in_the_file_is_refused(gcode: Path, tmp_path: Path, flags: list[str], told: str) -> None:
    done = typed("draw", gcode, "-o", tmp_path / "a.svg", *flags)

    assert done.code == 2
    assert is_message(done, " ".join(flags), told)
    assert not (tmp_path / "a.svg").exists()


@pytest.mark.parametrize(
    "flags",
    [
        ["--z", "-1"],
        ["--z", "nan"],
        ["--pixels", "99"],
        ["--pixels", "9000"],
        ["--box", "1,2,3"],
        ["--box", "1,2,1,5"],
        ["--layer", "2", "--z", "2"],
        ["--filament", "0"],
    ],
    ids=" ".join,
)
def test_what_makes_no_sense_is_refused(gcode: Path, tmp_path: Path, flags: list[str]) -> None:
    done = typed("draw", gcode, "-o", tmp_path / "a.svg", *flags)

    assert done.code == 2
    assert flags[0] in done.err


def test_pictures_go_only_where_they_can(gcode: Path, tmp_path: Path) -> None:
    taken = gcode.with_name("copy.svg")
    taken.write_bytes(gcode.read_bytes())

    assert is_message(typed("draw", gcode, "-o", tmp_path / "a.jpg"), "ends in .svg or .png")
    assert is_message(typed("draw", gcode, "-o", tmp_path / "no" / "a.svg"), "does not exist", "mkdir")
    assert is_message(typed("draw", gcode, "-o", "-", "--json"), "cannot both go to stdout")
    assert is_message(typed("draw", taken, "-o", taken), "copy.svg")
    assert taken.read_bytes() == gcode.read_bytes()


def test_a_dash_writes_the_svg_to_stdout(gcode: Path) -> None:
    done = typed("draw", gcode, "-o", "-")

    assert done.code == 0
    assert done.out.startswith("<svg ")
    assert done.out.endswith("</svg>\n")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"", "no extrusion"),
        (b"G28\nG1 X5\n", "no extrusion"),
        (b"GCDE\x01\x00", "binary"),
        (b"\xff\xfe\x00\x80" * 9, "not a G-code file"),
    ],
)
def test_files_that_lay_nothing_are_refused(tmp_path: Path, content: bytes, told: str) -> None:
    file = tmp_path / "odd.gcode"
    file.write_bytes(content)
    done = typed("draw", file, "-o", tmp_path / "a.svg")

    assert done.code == 2
    assert is_message(done, "odd.gcode", told)


def test_a_model_must_be_sliced_before_a_layer_is_drawn(tmp_path: Path) -> None:
    picture = tmp_path / "a.svg"

    for file, text in ((BOX, None), (tmp_path / "faces.obj", "f 1 2 3\nf 2 3 4\n")):
        if text:
            file.write_text(text)
        assert is_message(
            typed("draw", file, "-o", picture), "not a G-code file, but a model", f"slice {file}"
        )
    assert not picture.exists()


def test_without_a_name_the_picture_lies_beside_the_file_and_shows_its_worst_layer(
    gcode: Path, tmp_path: Path
) -> None:
    fine, faulty = tmp_path / "fine.gcode", tmp_path / "faulty.gcode"
    text = gcode.read_text()
    fine.write_text(text)
    before, mark, after = text.partition(";LAYER_CHANGE\n;Z:1.4")
    faulty.write_text(f"{before}G1 X900 F3000\nM92 E100\n{mark}{after}")

    done = typed("draw", fine)
    assert done.code == 0
    assert done.out.startswith(f"{tmp_path / 'fine.svg'}: layer 1 of 34")
    assert "the first layer, because no layer has findings" in done.out
    done = typed("draw", faulty)
    assert done.out.startswith(f"{tmp_path / 'faulty.svg'}: layer ")
    assert "the layer with the most findings (" in done.out
    assert "layer 1 of" not in done.out
    assert {fine.with_suffix(".svg"), faulty.with_suffix(".svg")} <= set(tmp_path.iterdir())


def test_the_layer_of_a_finding_is_found_in_a_file_without_layer_comments(tmp_path: Path) -> None:
    moves = "G28\nG90\nM83\nG1 Z0.2 F600\nG1 X50 E2 F1800\nG1 Z0.4\nG1 X80 E2\nM303 E0\nM999\nG1 X90 E1\n"
    (tmp_path / "bare.gcode").write_text(moves, encoding="utf-8")
    done = typed("draw", "bare.gcode", "-o", "bare.svg", cwd=tmp_path)

    assert "layer 2 of 2" in done.out
    assert "the layer with the most findings" in done.out


def test_layers_are_drawn_in_3d_up_to_the_one_that_is_named(gcode: Path, tmp_path: Path) -> None:
    whole, some = tmp_path / "whole.png", tmp_path / "some.svg"
    first, *beads = typed("draw", gcode, "--3d", "-o", whole, "--pixels", 200).out.splitlines()
    told = json.loads(typed("draw", gcode, "--3d", "--layer", 5, "-o", some, "--json").out)

    assert first == f"{whole}: layers 1 to 34 of 34, z 10 mm"
    assert any(line.strip().startswith("Top solid infill") for line in beads)
    assert whole.read_bytes().startswith(b"\x89PNG")
    assert texts(some)[0] == "box.gcode: layers 1 to 5 of 34, 1.4 mm high"
    assert told["in_3d"]
    assert told["layer"] == 5


@pytest.mark.parametrize("option", [("--travel",), ("--box", "0,0,10,10"), ("--model", BOX)])
def test_options_of_one_layer_do_not_apply_in_3d(
    gcode: Path, tmp_path: Path, option: tuple[object, ...]
) -> None:
    done = typed("draw", gcode, "--3d", "-o", tmp_path / "a.svg", *option)

    assert done.code == 2
    assert is_message(done, option[0], "--3d")
