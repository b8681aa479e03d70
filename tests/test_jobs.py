"""A model or a G-code file as a job: its commands, its layers, its time."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.commands import find_lines, split_gcode
from printer_slicer.errors import MeshError, PartError, PrinterSlicerError, UsageError
from printer_slicer.gcode.lexer import strip
from printer_slicer.gcode_text import gcode_of
from printer_slicer.input_files import GCODE_SUFFIXES, is_gcode
from printer_slicer.jobs import Job
from printer_slicer.mesh_io import load_mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from

PARTS = Path(__file__).parents[1] / "sample_parts"
PROFILE = load_profile("marlin_220", "pla", "standard", {"layer_height": 0.3, "first_layer_height": 0.2})
BOX_JOB = job_from(PARTS / "box.stl", PROFILE)

LINES = st.lists(
    st.sampled_from(
        ["G28", "G1 X5 F3000", "", "  ", ";LAYER_CHANGE", ";LAYER:3", "; a note", "M104 S0 ; off", "\tG4 P5 "]
    ),
    max_size=12,
)


def job_of(tmp_path: Path, text: bytes, name: str = "job.gcode") -> Job:
    path = tmp_path / name
    path.write_bytes(text)
    return job_from(path, PROFILE)


# Commands


def test_comments_blanks_and_empty_lines_are_no_commands() -> None:
    commands = list(split_gcode(b"; hello\n\n  G28 ; home\n \t\nG1 X5;Y9\n;G1 X7").commands)

    assert commands == [b"G28", b"G1 X5"]


def test_line_breaks_of_any_kind_end_a_command() -> None:
    for end in (b"\n", b"\r\n"):
        assert list(split_gcode(end.join([b"G28", b"G1 X5", b""])).commands) == [b"G28", b"G1 X5"]


def test_a_last_line_without_a_line_break_counts() -> None:
    assert list(split_gcode(b"G28\nG1 X5").commands) == [b"G28", b"G1 X5"]


@pytest.mark.parametrize("first", ["G28\n", "; made by an editor\nG28\n"])
def test_the_mark_that_editors_put_in_front_of_utf8_is_no_command(first: str) -> None:
    assert list(split_gcode(first.encode("utf-8-sig")).commands) == list(split_gcode(first.encode()).commands)
    assert find_lines(first.encode("utf-8-sig"), [0]) == find_lines(first.encode(), [0])


def test_an_empty_text_has_no_commands() -> None:
    told = split_gcode(b"")

    assert (len(told.commands), told.marks, told.roles) == (0, {}, {})


def test_layer_comments_count_from_one_and_belong_to_the_next_command() -> None:
    text = b"G28\n;LAYER_CHANGE\n;Z:0.2\nG1 X1\nG1 X2\n;LAYER_CHANGE\nG1 X3\n"

    assert split_gcode(text).marks == {1: 1, 3: 2}


def test_layer_comments_of_other_slicers_count_too() -> None:
    text = b";LAYER_COUNT:2\nG28\n;LAYER:0\nG1 X1\n;LAYER:1\nG1 X2\n"

    assert split_gcode(text).marks == {1: 1, 2: 2}


@given(LINES)
def test_commands_are_what_the_host_will_send(lines: list[str]) -> None:
    told = split_gcode("\n".join(lines).encode())
    commands, marks = list(told.commands), told.marks

    assert commands == [strip(command) for command in commands]
    assert all(commands)
    assert list(marks) == sorted(marks)
    assert list(marks.values()) == sorted(marks.values())


@pytest.mark.parametrize("line", [b"N12 G1 X5*97", b"N1 G28*18", b"M110 N0", b"G28\nM110 N5\nG1 X5"])
def test_commands_of_numbered_files_are_what_the_host_will_send(line: bytes) -> None:
    """A host strips numbers and checksums of the file and never sends M110: the job must say the same."""
    commands = list(split_gcode(line).commands)

    assert commands == [stripped for command in commands if (stripped := strip(command))]


@given(LINES)
def test_every_command_of_the_text_is_there_in_order(lines: list[str]) -> None:
    commands = list(split_gcode("\n".join(lines).encode()).commands)

    assert commands == [text.encode() for line in lines if (text := line.partition(";")[0].strip())]


# Files


@pytest.mark.parametrize("suffix", sorted(GCODE_SUFFIXES))
def test_gcode_is_known_by_its_suffix_in_any_case(suffix: str) -> None:
    assert is_gcode(Path(f"part{suffix}"))
    assert is_gcode(Path(f"part{suffix.upper()}"))
    assert not is_gcode(Path(f"part{suffix}.stl"))


@pytest.mark.parametrize("name", ["part.stl", "part", ".gcode", "part.3mf"])
def test_everything_else_is_taken_for_a_model(name: str) -> None:
    assert not is_gcode(Path(name))


def test_a_gcode_file_is_taken_as_it_is(tmp_path: Path) -> None:
    text = b"G28\r\nG1 X5 F3000 ; there\r\n"
    job = job_of(tmp_path, text)

    assert (job.name, job.text, list(job.commands)) == ("job.gcode", text, [b"G28", b"G1 X5 F3000"])
    assert job.program is None


@pytest.mark.parametrize("text", [b"", b"\n\n", b"; nothing\n;but comments\n", b" \t\r\n"])
def test_a_file_without_commands_is_refused_with_its_name(tmp_path: Path, text: bytes) -> None:
    with pytest.raises(UsageError, match=r"job\.gcode"):
        job_of(tmp_path, text)


def test_a_missing_gcode_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"nowhere\.gcode: no such file"):
        job_from(tmp_path / "nowhere.gcode", PROFILE)


def test_a_folder_with_the_suffix_of_gcode_is_called_a_folder(tmp_path: Path) -> None:
    (tmp_path / "folder.gcode").mkdir()
    with pytest.raises(UsageError) as caught:
        job_from(tmp_path / "folder.gcode", PROFILE)

    assert "folder.gcode" in str(caught.value)
    assert "permission" not in caught.value.remedy


def test_a_model_that_cannot_be_read_is_the_models_fault(tmp_path: Path) -> None:
    (tmp_path / "empty.stl").touch()
    with pytest.raises(MeshError, match=r"empty\.stl"):
        job_from(tmp_path / "empty.stl", PROFILE)


def test_a_part_that_does_not_fit_is_refused() -> None:
    small = load_profile("marlin_220", "pla", "standard", {"bed_z": 20})
    with pytest.raises(PartError, match="does not fit"):
        job_from(PARTS / "case_study.stl", small)


@given(st.binary(max_size=200))
def test_any_bytes_make_a_job_or_a_message(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "any.gcode"
    path.write_bytes(data)
    try:
        job = job_from(path, PROFILE)
    except PrinterSlicerError as error:
        message = str(error)
    else:
        message = job.name

    assert "any.gcode" in message


# What is known about a job


def test_a_sliced_job_is_the_text_of_its_program() -> None:
    stages = slice_stages(load_mesh(PARTS / "box.stl"), PROFILE)

    assert BOX_JOB.name == "box.stl"
    assert BOX_JOB.text == gcode_of(stages.program, PROFILE, part=stages.part)
    assert b"; thumbnail begin 300x300 " in BOX_JOB.text
    assert BOX_JOB.program is not None
    assert BOX_JOB.program.plan.top.tolist() == stages.program.plan.top.tolist()


def test_a_sliced_job_has_a_mark_for_every_layer() -> None:
    assert BOX_JOB.program is not None
    assert list(BOX_JOB.marks.values()) == list(range(1, BOX_JOB.program.plan.n_layers + 1))


def test_a_sliced_job_lays_plastic_at_the_tops_of_its_plan() -> None:
    assert BOX_JOB.program is not None
    tops = [round(float(top), 4) for top in BOX_JOB.program.plan.top]

    assert [z for z in BOX_JOB.heights if z in tops] == tops
    assert len(BOX_JOB.heights) - len(tops) <= 1  # the prime line may have a height of its own


def test_the_same_text_read_from_a_file_is_the_same_job(tmp_path: Path) -> None:
    again = job_of(tmp_path, BOX_JOB.text)

    assert list(again.commands) == list(BOX_JOB.commands)
    assert again.seconds == BOX_JOB.seconds
    assert again.heights == BOX_JOB.heights
    assert again.end == BOX_JOB.end
    assert again.marks == BOX_JOB.marks


def test_a_job_ends_where_its_last_move_leads(tmp_path: Path) -> None:
    assert job_of(tmp_path, b"G28\nG1 X5 Y6 Z7 F3000\nG91\nG1 Z1\n").end == (5, 6, 8)


def test_a_job_without_moves_ends_at_home_and_takes_the_time_of_its_dwells(tmp_path: Path) -> None:
    job = job_of(tmp_path, b"M104 S0\nG4 S2\nG4 P500\n")

    assert (job.end, job.seconds, job.heights) == ((0, 0, 0), 2.5, ())


def test_the_layer_of_a_command_is_that_of_the_last_mark_before_it(tmp_path: Path) -> None:
    job = job_of(tmp_path, b"G28\nG90\n;LAYER_CHANGE\nG1 X1\nG1 X2\n;LAYER_CHANGE\nG1 X3\nM84\n")

    assert [job.layer_of(command) for command in range(7)] == [0, 0, 1, 1, 2, 2, 2]


def test_a_job_without_layer_comments_has_no_layers(tmp_path: Path) -> None:
    job = job_of(tmp_path, b"G28\nG1 X5 F3000\n")

    assert [job.layer_of(command) for command in (0, 1, 2)] == [0, 0, 0]


def test_a_line_that_is_no_finite_move_does_not_make_the_time_infinite(tmp_path: Path) -> None:
    for word in (b"Xnan", b"Xinf", b"X1e300", b"X1e999"):
        seconds = job_of(tmp_path, b"G28\nG1 X5 F3000\nG1 " + word + b" Y1\n").seconds

        assert 0 < seconds < 1e9


def test_progress_is_told_by_stage() -> None:
    said: list[str] = []
    job_from(PARTS / "box.stl", PROFILE, report=said.append)

    assert said[0] == "loading"
    assert said[-1] == "writing"
    assert len(set(said)) == len(said)
