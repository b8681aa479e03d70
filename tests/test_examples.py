"""The shell examples of the documents, run as they stand, each document in a folder of its own.

Blocks marked `sh not-here` need a printer, a network or another environment; of them it is only checked, in
`test_house.py`, that they can be typed.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir
from math import cos, pi, sin
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from printer_slicer.cli import main
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.profile.folders import VARIABLE
from tests.parts import cone, loft, prism
from tests.waiting import LAST_RESORT

ROOT: Final = Path(__file__).parents[1]
# The gallery and the checking of it have tests of their own; the README's first commands are run by `just install`.
DOCUMENTS: Final = sorted(
    [
        *ROOT.glob("docs/tutorial/*.md"),
        *ROOT.glob("docs/how-to/*.md"),
        *(ROOT / "docs").glob("*.md"),
        ROOT / "README.md",
    ]
)
# What lies on no test's way: environments, printers, networks, files that only people have.
ELSEWHERE: Final = re.compile(
    r"pip install|/dev/tty|://|--pty|python -m (benchmarks|pytest)|benchmarks/|gallery/|\.3mf|bracket|figure"
)
SHELL: Final = re.compile(r"[|&;<>$*`#]|^\s*(for|do|done|mkdir)", re.MULTILINE)


def examples(path: Path) -> list[str]:
    """The blocks of a document that are run."""
    text = path.read_text(encoding="utf-8")
    found = re.findall(r"(?ms)^ *```sh\n(.*?)^ *```", text)
    return [block for block in found if not ELSEWHERE.search(block)]


def lines(block: str) -> Iterator[str]:
    for line in block.replace("\\\n", " ").splitlines():
        if line.strip():
            yield line.strip()


def vase() -> Mesh:
    """A belly, a neck and a lip around the z axis, of a few facets."""
    angles = [2 * pi * corner / 12 for corner in range(12)]
    circle = np.array([(cos(angle), sin(angle)) for angle in angles])
    return Mesh(loft([radius * circle for radius in (7.0, 8.0, 6.0, 8.0)], (0.0, 4.0, 9.0, 14.0)), "vase")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """With what the examples take for granted."""
    shutil.copytree(ROOT / "sample_parts", tmp_path / "sample_parts")
    box = load_mesh(ROOT / "sample_parts" / "box.stl")
    for name, left in {"part": 0, "lid": 0, "can": 40}.items():
        export_stl(Mesh(box.triangles + np.array([left, 0.0, 0.0]), name), tmp_path / f"{name}.stl")
    # Some are sliced ten times: smaller ones with fewer facets show as much, sooner.
    angles = [2 * pi * corner / 24 for corner in range(24)]
    cylinder = prism([(8 * cos(angle), 8 * sin(angle)) for angle in angles], 8.0)
    for name, small in {"vase": vase(), "cone": cone(6.0, 6.0, 12), "cylinder": cylinder}.items():
        export_stl(small, tmp_path / "sample_parts" / f"{name}.stl")
    script = tmp_path / "bin" / "printer-slicer"
    script.parent.mkdir()
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m printer_slicer "$@"\n')
    script.chmod(0o755)
    return tmp_path


def in_shell(block: str) -> None:
    """Run a block in a shell of its own."""
    done = subprocess.run(
        ["/bin/sh", "-e"], input=block, text=True, capture_output=True, timeout=LAST_RESORT, check=False
    )
    assert done.returncode == 0, f"{block}\n{done.stderr}"


def with_vase(path: Path) -> bool:
    """Whether a document speaks of a file that another one has made."""
    blocks = "\n".join(examples(path))
    return "vase.gcode" in blocks and "-o vase.gcode" not in blocks


@pytest.mark.parametrize("path", [path for path in DOCUMENTS if examples(path)], ids=lambda path: path.stem)
def test_the_shell_examples_of_a_document_run(
    path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", f"{folder / 'bin'}:/usr/bin:/bin")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv(VARIABLE, str(folder / "own"))
    with chdir(folder):
        if with_vase(path):
            assert main(["slice", "sample_parts/vase.stl", "-o", "vase.gcode", "--quiet"]) == 0
        for block in examples(path):
            if SHELL.search(block):
                in_shell(block)
                continue
            for line in lines(block):
                words = shlex.split(line)
                assert words[0] == "printer-slicer", line
                assert main(words[1:]) == 0, line


def test_documents_have_examples_that_run() -> None:
    assert sum(len(examples(path)) for path in DOCUMENTS) > 30
