"""The examples that --help shows are run as they stand, but for those that need a printer, a server or a terminal."""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

from printer_slicer.profile.folders import VARIABLE
from tests.cli.command_line import PARTS, ROOT, typed
from tests.mesh_io.tiny_files import binary_stl, item, mesh_xml, model_xml, three_mf
from tests.parts import box

COMMANDS: Final = (
    *("slice", "arrange", "plan", "contours", "check", "draw", "dry-run", "print"),
    *("ports", "profiles", "completion", "man"),
)
PLATE: Final = ("lid.stl", "box.3mf", "--rotate", "90")
ELSEWHERE: Final = re.compile(r"/dev/|://|--pty|--tcp|--port /tmp|config\.ini|\b(eval|source)\b|[|>]")


def examples() -> Iterator[str]:
    for command in COMMANDS:
        for line in typed(command, "--help-all").out.partition("examples:")[2].splitlines():
            example = re.split(r"  +", line.strip())[0].removesuffix("&").strip()
            if example.startswith("printer-slicer ") and not ELSEWHERE.search(example):
                yield example


@pytest.fixture(scope="module")
def shop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the examples name."""
    folder = tmp_path_factory.mktemp("shop")
    shutil.copytree(PARTS, folder / "sample_parts")
    (folder / "part.stl").write_bytes(binary_stl(box((6, 6, 12)).triangles))
    (folder / "lid.stl").write_bytes(binary_stl(box((8, 8, 2), at=(40, 0, 0)).triangles))
    (folder / "box.3mf").write_bytes(three_mf(model_xml({1: mesh_xml()}, item(1))))
    shutil.copytree(ROOT / "profiles", folder / "profiles")
    for made in (
        ("slice", "part.stl", "-o", "part.gcode", "--quality", "standard"),
        ("slice", *PLATE, "-o", "plate.gcode", "--set", "material.filament_diameter=2.85"),
        ("profiles", "new", "printer", "my_printer", "-o", "my_printer.toml"),
    ):
        outcome = typed(*made, cwd=folder)
        assert outcome.code == 0, outcome.err
    return folder


@pytest.mark.parametrize("command", ["slice", "plan", "dry-run", "print"])
def test_the_short_help_explains_the_options_of_its_examples(command: str) -> None:
    options, _, shown = typed(command, "--help").out.partition("examples:")

    assert [flag for flag in re.findall(r" (--[a-z-]+)", shown) if flag not in f"{options} --help-all"] == []
    assert max(map(len, shown.splitlines())) <= 100


TYPED_ELSEWHERE: Final = re.compile(r"--compare|case_study")
"""What takes longest, and is in the README, too."""


@pytest.mark.parametrize(
    "example",
    [
        pytest.param(one, marks=pytest.mark.thorough if TYPED_ELSEWHERE.search(one) else ())
        for one in sorted(set(examples()))
    ],
)
def test_the_examples_of_the_help_run(
    example: str, shop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    shutil.copytree(shop, folder)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    outcome = typed(*shlex.split(example)[1:], cwd=folder)

    assert outcome.code == 0, outcome.err
