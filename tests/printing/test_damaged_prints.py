"""A print with damaged files is named and skipped; all others can be resumed."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import UsageError
from printer_slicer.gcode.state import ModalState
from printer_slicer.jobs import build_job
from printer_slicer.printing import resume_print
from printer_slicer.printing.host_settings import HostSettings, make_host_settings
from printer_slicer.printing.job_store import (
    PortAddress,
    Print,
    create_print,
    find_damaged_prints,
    find_print,
    find_unfinished_print,
    load_stored_prints,
)
from printer_slicer.printing.journal import Journal, read_journal, restore_struct
from printer_slicer.printing.parking import ParkedState, parse_parked_state
from printer_slicer.printing.reattach import find_journal_damage
from printer_slicer.profile import load_profile
from tests.cli.command_line import typed

SETUP = make_host_settings(load_profile("marlin_220"))
TEXT = b"G28\nG1 X5 F600\nG1 X6\n"
PARKED = ParkedState(2, ModalState(1.0, 2.0, 0.2), park=True, replay=("G1 X5",))
BROUGHT = {"entries": 2, "stand": asdict(PARKED.stand), "replay": []}
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
NONSENSE = {
    "a word for a number": b"A three 5 1.0",
    "a negative number": b"A -3 5 1.0",
    "too few words": b"A 3",
    "a number as long as a book": b"E " + b"9" * 5000,
    "a time that is none": b"A 3 2 nan",
    "states that are a number": b"S 5",
    "states without an end": b"S " + b"[" * 100_000,
    "no text": b"N 3 2 \xff\xfe",
    "letters that no command has": "N 3 2 €".encode(),
    "a kind that nobody knows": b"Q 3",
}


def left(job_store: Path, name: str) -> Print:
    """A print that somebody has left."""
    made = create_print(job_store, name, TEXT, PortAddress("/dev/null", 115200), SETUP)
    journal = Journal(made.folder)
    journal.record_restart(0)
    journal.record_line(1, 0, b"M115")
    journal.record_accepted(2, 1, 10.0)
    journal.close()
    made.release()
    return made


def add(print_: Print, record: bytes) -> None:
    """One more record, with the right checksum."""
    with (print_.folder / "journal").open("ab") as file:
        file.write(b"%s %08x\n" % (record, crc32(record)))


def noted(**states: Any) -> bytes:
    """A record of states."""
    return b"S " + json.dumps(states).encode()


def job_store_in(folder: Path) -> tuple[Path, Print, Print]:
    job_store = folder / "prints"
    return job_store, left(job_store, "good.gcode"), left(job_store, "bad.gcode")


@pytest.mark.parametrize("record", NONSENSE.values(), ids=list(NONSENSE))
def test_a_record_that_makes_no_sense_is_named_and_blocks_no_other_print(
    record: bytes, tmp_path: Path
) -> None:
    job_store, good, bad = job_store_in(tmp_path)
    add(bad, record)
    (damage,) = find_damaged_prints(job_store)

    assert find_print(job_store, "", running=False).folder == good.folder
    assert str(damage).startswith(f"{bad.folder / 'journal'}: record 4 is invalid: ")
    assert (
        read_journal(bad.folder).entries == 1
    )  # what stands before it counts: the heaters can be switched off
    with pytest.raises(UsageError, match="record 4 is invalid"):
        find_print(job_store, "bad.gcode", running=False)


def no_file(path: Path) -> None:
    path.unlink(missing_ok=True)


def a_folder(path: Path) -> None:
    no_file(path)
    path.mkdir()


def a_pipe(path: Path) -> None:
    no_file(path)
    os.mkfifo(path)


@pytest.mark.parametrize(
    ("file", "spoil"),
    [
        ("head.json", a_folder),
        ("head.json", a_pipe),
        ("journal", no_file),
        ("journal", a_folder),
        ("journal", a_pipe),
        ("job.gcode", no_file),
        ("job.gcode", a_folder),
        ("job.gcode", a_pipe),
        ("lock", a_folder),
    ],
)
def test_a_file_that_is_none_is_named_and_blocks_no_other_print(
    file: str, spoil: Callable[[Path], None], tmp_path: Path
) -> None:
    job_store, good, bad = job_store_in(tmp_path)
    spoil(bad.folder / file)
    (damage,) = find_damaged_prints(job_store)

    assert str(damage).startswith(str(bad.folder / file))
    assert find_print(job_store, "", running=False).folder == good.folder
    assert find_unfinished_print(job_store, "/dev/null") is not None
    damage.delete()
    assert [one.folder for one in load_stored_prints(job_store)] == [good.folder]


@pytest.mark.parametrize("port", ["a\0b", "\ud800"])
def test_a_port_that_cannot_be_one_blocks_no_other_print(port: str, tmp_path: Path) -> None:
    job_store, good, bad = job_store_in(tmp_path)
    head = json.loads((bad.folder / "head.json").read_text(encoding="utf-8")) | {"port": port}
    (bad.folder / "head.json").write_text(json.dumps(head), encoding="utf-8")

    assert find_unfinished_print(job_store, "/dev/elsewhere") is None
    assert find_print(job_store, "", running=False).folder == good.folder
    assert "'port'" in str(next(find_damaged_prints(job_store)))


@given(name=st.sampled_from(["name", "port", "baud", "begun", "boot", "setup", None]), value=ANYTHING)
def test_a_head_of_anything_blocks_no_other_print(
    name: str | None, value: Any, shelves: Iterator[Path]
) -> None:
    job_store, good, bad = job_store_in(next(shelves))
    path = bad.folder / "head.json"
    head = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(value if name is None else {**head, name: value}), encoding="utf-8")
    damaged = list(find_damaged_prints(job_store))

    assert find_print(job_store, good.folder.name, running=False).folder == good.folder
    assert [damage.folder for damage in damaged] in ([], [bad.folder])
    for one in load_stored_prints(job_store):
        if one.folder not in {damage.folder for damage in damaged}:
            assert one.setup.flavour
            assert one.name + one.port + one.begun


@given(path=st.lists(st.integers(0, 20), min_size=1, max_size=3), value=ANYTHING)
def test_kept_values_come_back_as_they_were_or_are_refused(path: list[int], value: Any) -> None:
    for kept, kind in ((SETUP, HostSettings), (PARKED, ParkedState)):
        values = as_kept(kept)
        assert as_kept(restore_struct(kind, values)) == values
        place = values
        for step in path[:-1]:
            inner = [one for one in place.values() if isinstance(one, dict) and one]
            place = inner[step % len(inner)] if inner else place
        place[list(place)[path[-1] % len(place)]] = value
        with contextlib.suppress(TypeError):
            again = as_kept(restore_struct(kind, values))
            assert as_kept(restore_struct(kind, again)) == again


def as_kept(value: Any) -> Any:
    """As a file holds it."""
    return json.loads(json.dumps(asdict(value)))


@pytest.mark.parametrize(
    ("state", "told"),
    [
        ({"parked": 5}, "parked: Expected `object | null`, got `int`"),
        ({"parked": {"entries": 2}}, "missing"),
        ({"parked": asdict(PARKED) | {"spot": ["here", 0]}}, "spot[0]: Expected `float`, got `str`"),
        ({"parked": None, "phase": ["recovering"]}, "phase: Expected `str`, got `array`"),
        ({"cancelled_at": {"gear": 1_000_000}}, "an invalid command number"),
        (
            {"recovering_at": {"entries": 1, "stand": [], "replay": []}},
            "stand: Expected `object`, got `array`",
        ),
    ],
)
def test_a_state_that_makes_no_sense_is_named_before_the_port_is_opened(
    state: dict[str, Any], told: str, tmp_path: Path
) -> None:
    _, _, bad = job_store_in(tmp_path)
    add(bad, b"S " + json.dumps(state).encode())
    job = build_job("bad.gcode", TEXT, limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)

    with pytest.raises(UsageError, match="journal: ") as caught:
        resume_print(bad, job)
    assert told in str(caught.value)
    assert f"resume --discard {bad.folder.name}" in caught.value.remedy
    assert not bad.is_locked


def test_more_commands_than_the_job_has_cannot_have_been_accepted(tmp_path: Path) -> None:
    _, good, bad = job_store_in(tmp_path)
    add(bad, b"A 9 4 11.0")

    assert find_journal_damage(read_journal(good.folder), 3) == ""
    assert (
        find_journal_damage(read_journal(bad.folder), 3)
        == "the journal lists 4 accepted commands, but the job has 3"
    )


@pytest.mark.parametrize(
    ("record", "told"),
    [
        (b"A 9 4 11.0", "the journal lists 4 accepted commands, but the job has 3"),
        (b"E 4", "the journal lists 4 accepted commands, but the job has 3"),
        (b"N 9 4 M105", "the journal lists 4 accepted commands, but the job has 3"),
        (b'S {"parked": 5}', "a recorded state is invalid: parked: Expected `object | null`, got `int`"),
        (b'S {"phase": ["recovering"]}', "a recorded state is invalid: phase: "),
        (b'S {"cancelled_at": {"gear": 1000000}}', "a cancelled object has an invalid command number"),
        (
            b'S {"recovering_at": {"entries": 1, "stand": [], "replay": []}}',
            "stand: Expected `object`, got `array`",
        ),
        (
            noted(parked=replace(PARKED, entries=4).as_json()),
            "the journal resumes after 4 commands, but the job has 3",
        ),
        (
            noted(parked=replace(PARKED, entries=-1).as_json()),
            "the journal resumes after -1 commands, but the job has 3",
        ),
        (
            noted(recovering_at=BROUGHT | {"entries": 4}),
            "the journal resumes after 4 commands, but the job has 3",
        ),
    ],
)
def test_a_journal_that_no_print_of_this_job_wrote_is_named_and_blocks_no_other_print(
    record: bytes, told: str, own_job_store: Path
) -> None:
    job_store, good, bad = job_store_in(own_job_store)
    add(bad, record)
    (damage,) = find_damaged_prints(job_store)
    resumed = typed("resume")

    assert find_print(job_store, "", running=False).folder == good.folder
    assert str(damage).startswith(f"{bad.folder / 'journal'}: ")
    assert told in str(damage)
    assert f"printer-slicer: warning: {bad.folder / 'journal'}: " in resumed.err
    assert resumed.err.splitlines()[2] == "printer-slicer: /dev/null is not a serial port"
    with pytest.raises(UsageError, match="journal: "):
        find_print(job_store, "bad.gcode", running=False)


def test_a_job_without_commands_is_named_and_blocks_no_other_print(tmp_path: Path) -> None:
    job_store, good, bad = job_store_in(tmp_path)
    (bad.folder / "job.gcode").write_bytes(b"; nothing\n")
    (damage,) = find_damaged_prints(job_store)

    assert str(damage) == f"{bad.folder / 'job.gcode'}: the file contains no commands"
    assert find_print(job_store, "", running=False).folder == good.folder


def test_states_that_a_print_really_notes_make_sense(tmp_path: Path) -> None:
    _, good, _ = job_store_in(tmp_path)
    states = {
        "phase": "parking",
        "parked": PARKED.as_json(),
        "pushed": -2.5,
        "line": 1,
        "cancelled_at": {"a": 1},
        "recovering_at": BROUGHT,
    }
    add(good, b"S " + json.dumps(states).encode())

    assert find_journal_damage(read_journal(good.folder), 3) == ""
    assert parse_parked_state(read_journal(good.folder).states["parked"]) == PARKED


def test_the_command_line_names_what_it_skips_and_forgets_it_on_request(own_job_store: Path) -> None:
    _, good, bad = job_store_in(own_job_store)
    (bad.folder / "head.json").write_text("{", encoding="utf-8")
    listed, rows = typed("resume", "--list"), json.loads(typed("resume", "--list", "--json").out)
    resumed = typed("resume")

    assert (listed.code, listed.err) == (0, "")
    assert f"{bad.folder / 'head.json'}: the file is not JSON: " in listed.out
    assert [(row["id"], row["damaged"]) for row in rows] == [
        (good.folder.name, False),
        (bad.folder.name, True),
    ]
    assert f"printer-slicer: warning: {bad.folder / 'head.json'}: the file is not JSON: " in resumed.err
    assert resumed.err.splitlines()[2] == "printer-slicer: /dev/null is not a serial port"
    assert typed("resume", "--discard", bad.folder.name).code == 0
    assert not bad.folder.exists()
    assert typed("resume", "--list").out.startswith("good.gcode: started")
