"""Damaged files of every format are parts or our own errors; the seeds that once found something else stay here."""

from __future__ import annotations

from pathlib import Path

import pytest
from mutations import damaged
from tiny_files import every_format, write

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh

FOUND = [
    ("part.obj", 61),  # points in the plane
    ("part.obj", 66),
    ("part.obj", 10644),  # the last line continued by nothing
    ("ascii.ply", 4),  # vertices without facets, in other shapes than usual
    ("ascii.ply", 21),
    ("part.off", 21),
    ("part.off", 26),  # an open surface whose volume depended on which corner comes first
]
"""Name of the file, seed."""


def judge(folder: Path, name: str, content: bytes) -> bool:
    """Whether the file was read; else its error has the file and a remedy."""
    path = write(folder, content, name)
    mesh: Mesh | None = None
    refused: MeshError | UsageError | None = None
    try:
        mesh = load_mesh(path)
        repair(mesh)
    except (MeshError, UsageError) as error:
        refused = error
    if refused:
        assert (path.stem if mesh else str(path)) in str(refused)
        assert refused.remedy
    return mesh is not None


@pytest.mark.parametrize(("name", "seed"), FOUND)
def test_what_once_was_found_stays_mended(name: str, seed: int, tmp_path: Path) -> None:
    judge(tmp_path, name, damaged(every_format()[name], seed))


@pytest.mark.parametrize("name", every_format())
def test_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    content = every_format()[name]
    read = [judge(tmp_path, name, damaged(content, seed)) for seed in range(150)]

    assert judge(tmp_path, name, content)
    assert 0 < sum(read) < len(read)


@pytest.mark.parametrize("name", every_format())
def test_files_that_end_early_are_read_or_refused(name: str, tmp_path: Path) -> None:
    content = every_format()[name]

    for end in range(0, len(content), max(len(content) // 40, 1)):
        judge(tmp_path, name, content[:end])


WRITE_ONLY = Path("/proc/sys/vm/compact_memory")


@pytest.mark.skipif(not WRITE_ONLY.exists(), reason="no file here that may be written only, whoever asks")
def test_a_file_that_may_not_be_read_is_told_as_that(tmp_path: Path) -> None:
    path = tmp_path / "secret.stl"
    path.symlink_to(WRITE_ONLY)
    with pytest.raises(UsageError) as caught:
        load_mesh(path)

    assert str(caught.value) == f"{path}: permission denied\n  Check its permissions"
