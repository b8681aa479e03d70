"""The commands of the queue, and what it says about printers and jobs."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from printer_slicer.errors import UsageError
from printer_slicer.print_queue.file_facts import FileFacts, format_facts, parse_facts, read_file_facts
from printer_slicer.print_queue.folders import default_queue_folder
from printer_slicer.print_queue.matching import PrinterTraits, find_mismatches
from printer_slicer.print_queue.printers import read_printers
from printer_slicer.print_queue.records import QueuedJob
from printer_slicer.values import replace
from tests.cli.command_line import BOX, QUICK, Outcome, typed

PRINTERS = """
[left]
port = "/dev/left"
profile = "marlin_220"
groups = ["both"]
[right]
port = "/dev/right"
profile = "marlin_220"
material = "petg"
groups = ["both"]
[small]
port = "sim:"
profile = "voron_0_2"
"""
GCODE = "G28\nG90\nM83\nG1 Z0.2 F600\nG1 X10 Y10\nG1 X50 Y40 E1\nG1 X10 Y10 E2\n"
JOB = QueuedJob(1, "part.gcode", "", "ready", "", "", (), 0.0, "", "")
FACTS = FileFacts(low=(10, 10, 0.2), high=(50, 40, 9), flavour="marlin", nozzle=0.4, material="PLA")
TRAITS = PrinterTraits((0, 0, 0), (200, 180, 100), "marlin", 0.4, "PLA", "my_pla")
Typed = Callable[..., Outcome]


@pytest.fixture
def queue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Typed:
    """Type an action of `queue` in a folder with a file `part.gcode`."""
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path / "state"))
    monkeypatch.setenv("PRINTER_SLICER_PRINTERS", str(tmp_path / "printers.toml"))
    (tmp_path / "printers.toml").write_text(PRINTERS, encoding="utf-8")
    (tmp_path / "part.gcode").write_text(GCODE, encoding="utf-8")
    return lambda *words: typed("queue", *words, cwd=tmp_path)


def facts_of(outcome: Outcome) -> dict[str, object]:
    assert outcome.code == 0, outcome.err
    return dict(json.loads(outcome.out))


def test_the_help_fits_on_a_page_and_shows_examples() -> None:
    said = typed("queue", "--help").out

    assert len(said.splitlines()) <= 40
    assert "queue clear-bed" in said


def test_jobs_are_added_listed_and_moved(queue: Typed) -> None:
    assert queue("add", "part.gcode", "--copies", 2, "--printer", "both").out.startswith(
        "job 1: part.gcode ("
    )
    queue("add", "part.gcode", "--held", "--first")
    assert [job["id"] for job in facts_of(queue("--json"))["jobs"]] == [3, 1, 2]  # type: ignore[attr-defined]

    queue("move", 2, "first")
    queue("move", "#3", "last")
    queue("move", 1, "before", 2)
    said = queue("list").out.splitlines()
    assert [line.split(":")[0] for line in said] == ["left", "right", "small", "job 1", "job 2", "job 3"]
    assert said[0] == "left: bed may be occupied, pla is loaded"
    assert said[3].endswith(" for both, ready")
    assert said[5].endswith(", held")


def test_jobs_are_held_released_and_cancelled(queue: Typed) -> None:
    queue("add", "part.gcode", "--copies", 2)

    assert queue("hold", 1, 2).out == "job 1: held\njob 2: held\n"
    assert queue("release", 1).out == "job 1: ready\n"
    assert queue("cancel", 1, 2).out.count("cancelled before it was started") == 2
    assert queue("list").out.endswith("no jobs\n")
    assert "job 2: part.gcode" in queue("list", "--all").out


def test_a_job_that_does_not_exist_changes_no_other(queue: Typed) -> None:
    queue("add", "part.gcode")

    outcome = queue("cancel", 1, 7)

    assert (outcome.code, outcome.err.splitlines()[0]) == (2, "printer-slicer: there is no job 7")
    assert queue("list").out.endswith("ready\n")


def test_the_queue_says_in_words_why_a_job_waits(queue: Typed) -> None:
    queue("add", "part.gcode", "--material", "petg", "--copies", 2)
    queue("clear-bed", "right")

    said = queue("explain", 2).out.splitlines()
    assert said == [
        "job 2 waits for a program that starts jobs: run printer-slicer queue run",
        "  left: PLA is loaded, petg is wanted",
        "  right: job 1 is before it in the queue",
        "  small: PLA is loaded, petg is wanted",
    ]
    queue("occupy-bed", "right")
    queue("load", "left", "petg")
    said = queue("explain", 1).out.splitlines()
    assert (
        said[1] == "  left: its bed may be occupied: run printer-slicer queue clear-bed left when it is clear"
    )
    assert (
        said[2] == "  right: its bed is occupied: run printer-slicer queue clear-bed right when it is clear"
    )
    queue("hold", 1)
    assert queue("explain", 1).out.startswith(
        "job 1 is held until it is released: run printer-slicer queue release 1\n"
    )


def test_a_job_that_fits_nowhere_says_so(queue: Typed) -> None:
    queue("add", "part.gcode", "--material", "petg", "--printer", "small")

    found = facts_of(queue("explain", 1, "--json"))

    assert found["summary"] == "no printer can print job 1"
    assert found["printers"][0] == {  # type: ignore[index]
        "printer": "left",
        "fits": False,
        "reasons": ["the job is for small"],
        "remedy": "",
    }


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("add",), "queue add: wrong number of arguments (0)"),
        (("add", "box.stl"), "box.stl: the queue takes G-code files"),
        (("add", "missing.gcode"), "missing.gcode: cannot be read: No such file or directory"),
        (("add", "part.gcode", "--printer", "middle"), "there is no printer or group middle"),
        (("add", "part.gcode", "--copies", "2000"), "cannot add 2000 copies"),
        (("move", "1", "up"), "queue move 1 up: unknown place"),
        (("explain", "one"), "one is not the number of a job"),
        (("clear-bed", "middle"), "there is no printer middle"),
        (("load", "left"), "queue load: wrong number of arguments (1)"),
        (("list", "1"), "queue list: wrong number of arguments (1)"),
    ],
)
def test_errors_are_plain_and_have_a_remedy(queue: Typed, words: tuple[str, ...], message: str) -> None:
    outcome = queue(*words)

    first, remedy = outcome.err.splitlines()
    assert (outcome.code, first) == (2, f"printer-slicer: {message}")
    assert remedy.startswith("  ")


def test_a_file_without_commands_is_not_printed(queue: Typed, tmp_path: Path) -> None:
    (tmp_path / "empty.gcode").write_text("; nothing\n", encoding="utf-8")

    queue("add", "empty.gcode")

    assert queue("explain", 1).out.splitlines()[0] == "no printer can print job 1"


def test_a_print_outside_the_queue_occupies_the_bed(queue: Typed, tmp_path: Path) -> None:
    queue("clear-bed", "left", "right")

    outcome = typed("print", "part.gcode", "--port", "/dev/left", "--allow", "cold", cwd=tmp_path)

    assert outcome.code == 4  # there is no such port
    assert [line.split(",")[0] for line in queue("list").out.splitlines()[:2]] == [
        "left: bed occupied",
        "right: bed clear",
    ]


# Files and printers


def test_a_file_sliced_here_tells_all_facts(tmp_path: Path) -> None:
    typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK)

    facts = read_file_facts(tmp_path / "box.gcode", "box.gcode")

    assert (facts.flavour, facts.nozzle, facts.material, facts.problem) == ("marlin", 0.4, "PLA", "")
    assert facts.high is not None
    assert facts.high[2] == pytest.approx(10, abs=0.3)
    assert facts.layers > 30
    assert facts.seconds > 60
    assert facts.filament > 100
    assert parse_facts(format_facts(facts)) == facts


def test_a_file_of_unknown_origin_tells_its_size_only(tmp_path: Path) -> None:
    (tmp_path / "part.gcode").write_text(GCODE, encoding="utf-8")

    facts = read_file_facts(tmp_path / "part.gcode", "part.gcode")

    assert (facts.low, facts.high) == ((10, 10, 0.2), (50, 40, 0.2))
    assert (facts.flavour, facts.nozzle, facts.material, facts.filament) == ("", None, "", 3)
    assert find_mismatches(JOB, facts, TRAITS) == []


@pytest.mark.parametrize(
    ("changes", "reasons"),
    [
        ({}, []),
        ({"high": (210, 40, 9)}, ["the part extends from 10 to 210 mm in x, the printer from 0 to 200 mm"]),
        ({"low": (-5, 10, 0.2)}, ["the part extends from -5 to 50 mm in x, the printer from 0 to 200 mm"]),
        ({"high": (50, 40, 101)}, ["the part extends from 0.2 to 101 mm in z, the printer from 0 to 100 mm"]),
        ({"nozzle": 0.6}, ["the nozzle is 0.4 mm, 0.6 mm is wanted"]),
        ({"nozzle": None, "material": "", "flavour": ""}, []),
        ({"material": "PETG"}, ["PLA is loaded, PETG is wanted"]),
        ({"material": "pla"}, []),
        ({"flavour": "klipper"}, ["the firmware understands marlin, the file is for klipper"]),
        ({"flavour": "marlin_legacy"}, []),
        ({"low": None, "high": None}, ["the file extrudes nothing"]),
        ({"problem": "part.gcode: no commands"}, ["part.gcode: no commands"]),
    ],
)
def test_a_printer_that_does_not_fit_has_reasons(changes: dict[str, object], reasons: list[str]) -> None:
    assert find_mismatches(JOB, replace(FACTS, **changes), TRAITS) == reasons


def test_a_job_may_name_another_material_than_its_file() -> None:
    assert find_mismatches(replace(JOB, material="petg"), FACTS, TRAITS) == ["PLA is loaded, petg is wanted"]
    assert find_mismatches(replace(JOB, material="MY_PLA"), replace(FACTS, material="ABS"), TRAITS) == []
    assert find_mismatches(JOB, None, TRAITS) == ["the file has not been read yet"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "there are no printers"),
        ("[a]\nprofile = 'x'", "a: port is missing"),
        ("[a]\nport = '/dev/a'", "a: profile is missing"),
        ("[a]\nport = '/dev/a'\nprofile = 'x'\ncolour = 'red'", "a: unknown key colour"),
        ("[a]\nport = '/dev/a'\nprofile = 7", "a: profile is a value of type int"),
        ("[a]\nport = '/dev/a'\nprofile = 'x'\nbaud = -1", "a: baud is a value of type int, or out of range"),
        ("[a]\nport = '/dev/a'\nprofile = 'x'\nguard = inf", "a: guard is a value of type float"),
        ("[a]\nport = '/dev/a'\nprofile = 'x'\nspeed = 2", "a: speed is for simulated printers only"),
        ("['a b']\nport = '/dev/a'\nprofile = 'x'", "'a b' is not a valid name of a printer"),
        ("a = 1", "a: is not a table"),
        ("[a]\nport = 'p'\nprofile = 'x'\n[b]\nport = 'p'\nprofile = 'x'", "a and b have the same port p"),
        ("[a]\nport = 'p'\nprofile = 'x'\ngroups = ['a']", "a: the group a has the name of a printer"),
        ("[a\n", "line 1"),
    ],
)
def test_an_invalid_file_of_printers_names_the_place(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "printers.toml").write_text(text, encoding="utf-8")

    with pytest.raises(UsageError) as raised:
        read_printers(tmp_path / "printers.toml")

    assert str(raised.value.args[0]).startswith(f"{tmp_path / 'printers.toml'}: {message}")
    assert raised.value.remedy


def test_without_printers_the_queue_says_how_to_name_them(queue: Typed, tmp_path: Path) -> None:
    (tmp_path / "printers.toml").unlink()

    outcome = queue("list")

    assert outcome.code == 2
    assert "there is no such file, so the queue has no printers" in outcome.err


def test_a_queue_is_a_database_that_others_can_read(queue: Typed) -> None:
    queue("add", "part.gcode")

    connection = sqlite3.connect(default_queue_folder() / "queue.sqlite")
    assert connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert connection.execute("SELECT name, state FROM job").fetchall() == [("part.gcode", "ready")]
    connection.close()
