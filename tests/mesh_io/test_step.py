"""STEP through the optional package, and without it."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from signal import SIGABRT

import numpy as np
import pytest
from tiny_files import write
from tiny_step import step_box

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io import Limits, load_mesh, load_model

needs_cascadio = pytest.mark.skipif(find_spec("cascadio") is None, reason="the extra step is not installed")


@needs_cascadio
@pytest.mark.parametrize(
    ("prefix", "mm", "name"),
    [("$", 1000.0, "part"), pytest.param(".MILLI.", 1.0, "part.STP", marks=pytest.mark.thorough)],
)
def test_a_step_file_says_its_unit_and_keeps_z_up(tmp_path: Path, prefix: str, mm: float, name: str) -> None:
    """It is known by either extension, and by how it begins; its unit is doubted with a flag that it takes."""
    model = load_model(write(tmp_path, step_box(1 / mm, 2 / mm, 2 / mm, prefix=prefix), name))

    np.testing.assert_allclose(model.mesh.bounds, [[0, 0, 0], [1, 2, 2]], atol=1e-5)
    assert model.mesh.n_facets == 12
    assert (model.kind, model.unit) == ("step", "mm")
    assert "in inches, `scale=25.4` makes the part 25.4 x 50.8 x 50.8 mm" in model.size_warning()


@needs_cascadio
@pytest.mark.thorough  # a failed conversion is tried with less below
def test_a_step_file_without_solids_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path, "ISO-10303-21;\nhello", "part.step")

    with pytest.raises(MeshError, match="STEP") as caught:
        load_model(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy


def test_the_unit_of_a_step_file_cannot_be_changed(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="states its own unit") as caught:
        load_model(write(tmp_path, step_box(2, 3, 4), "part.step"), units="inch")
    assert "`scale`" in caught.value.remedy


def with_package(folder: Path, code: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package of that name which does something else, here and in processes that are started."""
    (folder / "cascadio.py").write_text(code, encoding="utf-8")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("PYTHONPATH", str(folder))


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("import os\nos.abort()", f"exit code {-SIGABRT}"),
        ("raise ImportError('libGL.so.1: no such file')", "ImportError: libGL.so.1: no such file"),
    ],
    ids=["crash", "half installed"],
)
def test_a_conversion_that_fails_says_why(
    code: str, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_package(tmp_path, code, monkeypatch)
    path = write(tmp_path, step_box(2, 3, 4), "part.step")
    with pytest.raises(MeshError) as caught:
        load_mesh(path)

    assert str(caught.value) == (
        f"{path}: OpenCASCADE cannot convert the file: {why}\n  Export the part as STL or 3MF from CAD"
    )


def test_a_conversion_that_takes_too_long_is_given_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_package(tmp_path, "import time\ntime.sleep(99)", monkeypatch)
    path = write(tmp_path, step_box(2, 3, 4), "part.step")
    with pytest.raises(MeshError) as caught:
        load_mesh(path, limits=Limits(step_seconds=0.01))

    wrong = "the STEP conversion took longer than 0.01 s"
    assert str(caught.value) == f"{path}: {wrong}\n  Export the part as STL or 3MF from CAD"


def test_without_the_package_the_command_that_installs_it_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, step_box(2, 3, 4), "part.step")
    code = (
        "import sys\n"
        "sys.modules['cascadio'] = None\n"
        "from printer_slicer.errors import UsageError\n"
        "from printer_slicer.mesh_io import load_mesh\n"
        "try:\n"
        "    load_mesh(sys.argv[1])\n"
        "except UsageError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)

    assert "reading STEP files needs the package cascadio" in done.stdout
    assert "python -m pip install 'printer-slicer[step]'" in done.stdout
