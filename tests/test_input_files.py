"""Files, pipes and devices that a person names."""

from __future__ import annotations

import errno
import os
import threading
from pathlib import Path

import pytest

from printer_slicer.cli.inputs import reject_non_gcode
from printer_slicer.input_files import open_input, read_input

needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")

    assert read_input(path, 5) == b"12345"
    for most in (4, 0, -1):
        with pytest.raises(OSError, match="longer than") as caught:
            read_input(path, most)
        assert caught.value.errno == errno.EFBIG


@needs_pipes
def test_a_pipe_that_nobody_writes_to_is_given_up_and_leaves_no_thread(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    before = threading.active_count()

    with pytest.raises(TimeoutError, match="no program writes"):
        open_input(path, 0.01)

    assert threading.active_count() == before


@needs_pipes
def test_what_a_writer_says_in_pieces_is_read_whole_up_to_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)

    def write() -> None:
        with path.open("wb", buffering=0) as pipe:
            for piece in (b"one ", b"two ", b"three"):
                pipe.write(piece)

    for most, is_read in ((13, True), (12, False)):
        writer = threading.Thread(target=write)
        writer.start()
        if is_read:
            assert read_input(path, most, writer_seconds=300) == b"one two three"
        else:
            with pytest.raises(OSError, match="longer than"):
                read_input(path, most, writer_seconds=300)
        writer.join()


def test_a_name_that_no_file_can_have_and_a_folder_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="null"):
        read_input(Path("a\0b"), 10)
    with pytest.raises(OSError, match=r"directory|denied"):
        read_input(tmp_path, 10)


@needs_pipes
def test_a_pipe_is_not_opened_only_to_look_whether_it_is_gcode(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.gcode"
    os.mkfifo(pipe)

    reject_non_gcode(pipe)
