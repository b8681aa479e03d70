"""The journal: what is read is what was written, however it ends."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.printing.journal import LOST, Journal, read_journal


def written(folder: Path) -> Journal:
    journal = Journal(folder)
    journal.record_restart(0)
    journal.record_line(1, 0, b"M115")
    journal.record_line(2, 0, b"M105")
    journal.record_accepted(12, 10, 100.0)
    journal.record_line(15, 12, b"M117 5 > 4; \xe9")
    journal.record_accepted(20, 17, 101.5)
    return journal


def test_numbers_lead_to_entries(tmp_path: Path) -> None:
    written(tmp_path).close()
    journal_data = read_journal(tmp_path)

    assert (journal_data.line, journal_data.entries) == (20, 17)
    assert [journal_data.count_entries_until(n) for n in (0, 1, 2, 3, 12, 14, 15, 16, 20, 22)] == [
        0,
        0,
        0,
        1,
        10,
        12,
        12,
        13,
        17,
        19,
    ]
    assert journal_data.commands == [(0, b"M115"), (0, b"M105"), (12, b"M117 5 > 4; \xe9")]
    assert journal_data.accepted == [(10, 100.0), (17, 101.5)]
    assert journal_data.stopped is None


def test_what_is_not_accepted_for_certain_is_told_by_the_printer(tmp_path: Path) -> None:
    journal = written(tmp_path)
    journal.record_line(21, 17, b"G1 Z5")
    journal.close()
    journal_data = read_journal(tmp_path)

    assert (17, b"G1 Z5") not in journal_data.list_inserted_commands_until(20)
    assert (17, b"G1 Z5") in journal_data.list_inserted_commands_until(21)


def test_numbers_that_begin_anew_forget_what_had_them_before(tmp_path: Path) -> None:
    journal = written(tmp_path)
    journal.record_restart(17)
    journal.record_line(1, 17, b"M115")
    journal.close()
    journal_data = read_journal(tmp_path)

    assert (journal_data.base, journal_data.before, journal_data.line, journal_data.entries) == (
        17,
        20,
        0,
        17,
    )
    assert journal_data.count_entries_until(1) == 17


def test_a_printer_greeted_anew_has_other_lines_under_the_same_numbers(tmp_path: Path) -> None:
    journal = Journal(tmp_path)
    journal.record_restart(0)
    for _ in range(2):
        journal.record_line(1, 0, b"M115")
        journal.record_line(2, 0, b"M105")
    journal.close()

    assert read_journal(tmp_path).count_entries_until(5) == 3
    assert len(read_journal(tmp_path).lines) == 2


def test_the_time_of_the_loss_is_the_first_one(tmp_path: Path) -> None:
    journal = written(tmp_path)
    journal.record_end(f"{LOST}unplugged", 102.0)
    journal.record_end("gave up", 132.0)
    journal.close()
    journal_data = read_journal(tmp_path)

    assert (journal_data.stopped, journal_data.reason) == (102.0, f"{LOST}unplugged")


@given(cut=st.integers(0, 400), noise=st.binary(max_size=40))
def test_a_torn_end_tells_all_that_is_whole(
    tmp_path_factory: pytest.TempPathFactory, cut: int, noise: bytes
) -> None:
    folder = tmp_path_factory.mktemp("torn")
    written(folder).close()
    path = folder / "journal"
    whole = path.read_bytes()
    path.write_bytes(whole[:cut] + noise)
    kept = whole[:cut].count(b"\n")
    journal_data = read_journal(folder)

    assert journal_data.line in {0, 12, 20}
    assert journal_data.line >= {0: 0, 1: 0, 2: 0, 3: 0, 4: 12, 5: 12, 6: 20}[kept]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full disk here")
def test_a_full_disk_is_noticed_and_nothing_else_happens(tmp_path: Path) -> None:
    (tmp_path / "journal").symlink_to("/dev/full")
    journal = Journal(tmp_path)
    journal.record_restart(0)
    journal.record_accepted(1, 1, 1.0)
    journal.sync()
    journal.close()

    assert journal.failure == os.strerror(28)


def test_a_folder_that_is_gone_is_a_journal_that_failed(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "gone")
    journal.record_accepted(1, 1, 1.0)

    assert journal.failure


@pytest.mark.skipif(sys.platform == "win32", reason="other permissions")
def test_nobody_else_reads_it(tmp_path: Path) -> None:
    written(tmp_path).close()

    assert (tmp_path / "journal").stat().st_mode & 0o777 == 0o600
