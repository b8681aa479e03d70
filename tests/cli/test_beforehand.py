"""`check` without a model: what a file holds, and where a link is too slow for it."""

from __future__ import annotations

import json
from math import cos, sin
from pathlib import Path

import pytest

from tests.cli.command_line import typed

PARTS = Path(__file__).parents[2] / "sample_parts"


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A layer of long moves, one of 0.2 mm chords at 60 mm/s, one of long moves."""
    path = tmp_path_factory.mktemp("dense") / "dense.gcode"
    square = ["G1 X70 Y70 F3600", "G1 X150 Y70 E3", "G1 X150 Y150 E3", "G1 X70 Y150 E3", "G1 X70 Y70 E3"]
    circle = [
        f"G1 X{100 + 20 * cos(i / 100):.3f} Y{100 + 20 * sin(i / 100):.3f} E.0066" for i in range(1, 3001)
    ]
    lines = ["G21", "M104 S200", "G28", "M83", "M109 S200", "G1 Z.3 F300"]
    for layer in (square, ["G1 X120 Y100", *circle], square):
        lines += [";LAYER_CHANGE", *layer]
    path.write_text("\n".join([*lines, "M104 S0"]))
    return path


# Quick enough to want 300 lines a second on such a circle.
QUICK = [
    f"--set=printer.{name}=3000" for name in ("acceleration", "max_acceleration_x", "max_acceleration_y")
]


def test_a_slow_link_is_told_by_layer_and_lines(dense: Path) -> None:
    done = typed("check", dense, "--link", "57600", "--latency", "2", *QUICK)

    assert done.code == 7
    assert "layer 2, lines" in done.out
    assert "lines/s needed" in done.out
    assert "--set printer.link_lines_per_second=" in done.out
    assert "the serial link is too slow" in done.err


def test_the_same_for_programs(dense: Path) -> None:
    facts = json.loads(typed("check", dense, "--link", "57600", "--json", *QUICK).out)
    (underrun,) = facts["link"]["underruns"]

    assert (facts["ok"], facts["link"]["ok"]) == (False, False)
    assert underrun["layer"] == 2
    lines = dense.read_text().splitlines()
    assert lines.index(";LAYER_CHANGE") < underrun["line"] < underrun["last_line"] <= len(lines)
    assert underrun["lines_per_second_needed"] == pytest.approx(300, rel=0.1)
    assert underrun["lines_per_second_available"] == pytest.approx(facts["link"]["lines_per_second"], rel=0.1)
    assert underrun["seconds"] == pytest.approx(
        3000 / underrun["lines_per_second_available"] - 3000 / underrun["lines_per_second_needed"], rel=0.1
    )


def test_a_quick_link_is_well(dense: Path) -> None:
    done = typed("check", dense, "--link", "250000", *QUICK)

    assert (done.code, done.err) == (0, "")
    assert "no buffer underruns" in done.out


def test_latency_and_window_count(dense: Path) -> None:
    def rate(*flags: str) -> float:
        out = typed("check", dense, "--link", "250000", "--json", *QUICK, *flags).out
        return float(json.loads(out)["link"]["lines_per_second"])

    assert rate("--latency", "16", "--window", "1") < rate("--latency", "16") < rate("--latency", "1")


def test_slicing_for_the_link_that_was_told_is_enough(tmp_path: Path) -> None:
    """The advice works: what is sliced for the rate of the link never waits on it."""
    out, link = tmp_path / "cylinder.gcode", ["--link", "9600", "--latency", "1"]
    assert typed("slice", PARTS / "cylinder.stl", "-o", out, "--set", "labels=none").code == 0
    told = json.loads(typed("check", out, *link, "--json").out)
    assert told["ok"] is False

    rate = told["link"]["advice"].partition("per_second=")[2].partition(",")[0]
    slow = f"printer.link_lines_per_second={rate}"
    assert typed("slice", PARTS / "cylinder.stl", "-o", out, "--set", slow).code == 0
    again = json.loads(typed("check", out, *link, "--json").out)

    lost = [sum(one["seconds"] for one in facts["link"]["underruns"]) for facts in (told, again)]
    assert lost[1] < 0.1 * lost[0]


def test_what_a_file_holds_is_told_without_a_model(dense: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.gcode"
    bad.write_text(dense.read_text() + "\nM500\n")

    assert typed("check", dense).code == 0
    done = typed("check", bad)
    assert done.code == 7
    assert "M500" in done.err
    assert typed("check", bad, "--allow", "eeprom").code == 0
    facts = json.loads(typed("check", bad, "--json").out)
    assert [one["name"] for one in facts["lint"]] == ["eeprom"]


def test_pictures_and_limits_want_a_model(dense: Path, tmp_path: Path) -> None:
    done = typed("check", dense, "--picture", tmp_path / "a.svg")

    assert done.code == 2
    assert "--model" in done.err
