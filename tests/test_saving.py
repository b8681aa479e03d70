"""Files are written whole or not at all, also from pieces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from printer_slicer.errors import OutputError, ProfileError
from printer_slicer.saving import save


def test_pieces_become_one_file(tmp_path: Path) -> None:
    path = tmp_path / "x.gcode"
    save(path, iter([b"G28\n", b"", b"G1 X1\n"]))

    assert path.read_bytes() == b"G28\nG1 X1\n"
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_appears_after_its_last_piece(tmp_path: Path) -> None:
    path = tmp_path / "x.gcode"
    path.write_bytes(b"old")
    seen: list[tuple[bytes, list[bytes]]] = []

    def make() -> Iterator[bytes]:
        for piece in (b"1", b"2"):
            others = [one.read_bytes() for one in tmp_path.iterdir() if one != path]
            seen.append((path.read_bytes(), others))
            yield piece

    save(path, make())
    assert seen == [(b"old", [b""]), (b"old", [b"1"])]
    assert path.read_bytes() == b"12"


@pytest.mark.parametrize("error", [ProfileError("a macro"), ValueError("a defect"), KeyboardInterrupt()])
def test_an_error_between_pieces_keeps_the_old_file_and_its_own_type(
    tmp_path: Path, error: BaseException
) -> None:
    path = tmp_path / "x.gcode"
    path.write_bytes(b"old")

    def make() -> Iterator[bytes]:
        yield b"G28\n"
        raise error

    with pytest.raises(type(error)) as caught:
        save(path, make())
    assert caught.value is error
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_device_ends_the_pieces() -> None:
    made: list[int] = []

    def make() -> Iterator[bytes]:
        for number in range(3):
            made.append(number)
            yield b"G28\n"

    with pytest.raises(OutputError, match="No space left"):
        save(Path("/dev/full"), make())
    assert made == [0]
