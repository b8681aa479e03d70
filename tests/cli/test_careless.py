"""What people type in haste: names of nothing, pipes, outputs over inputs, flags that lead nowhere."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from command_line import BOX, QUICK, Outcome, is_message, typed


def test_a_model_out_of_a_pipe_needs_a_name_for_its_gcode(tmp_path: Path) -> None:
    def piped(*flags: object) -> Outcome:
        read_end, write_end = os.pipe()
        os.write(write_end, BOX.read_bytes())
        os.close(write_end)
        outcome = typed("slice", f"/dev/fd/{read_end}", *flags, *QUICK)
        os.close(read_end)
        return outcome

    assert is_message(piped(), "not a regular file, so the G-code needs a name", "-o")
    assert piped("-o", tmp_path / "box.gcode").code == 0


@pytest.mark.parametrize("flag", ["--printer", "--material", "--quality"])
def test_a_profile_without_a_name_is_refused(flag: str) -> None:
    """As of a variable of the shell that is not set; another printer's moves would be made."""
    assert is_message(typed("slice", BOX, flag, ""), f"{flag}: the name is empty", "Leave the option out")


def test_a_layer_without_a_picture_is_refused(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", "--layer", "3", *QUICK)

    assert is_message(outcome, "--layer 3: this option has no effect without --picture", "--picture")
    assert not (tmp_path / "b.gcode").exists()


def test_gcode_and_picture_are_not_written_over_each_other(tmp_path: Path) -> None:
    both = tmp_path / "both.svg"

    assert is_message(
        typed("slice", BOX, "-o", both, "--picture", both, *QUICK), "have the same name", "both.svg"
    )
    assert not both.exists()


def test_the_model_is_never_overwritten_by_a_report(tmp_path: Path) -> None:
    model = tmp_path / "box.stl"
    model.write_bytes(BOX.read_bytes())
    outcome = typed("sim", "--expect", model, "--report", model, "--pty", tmp_path / "printer")

    assert is_message(outcome, "box.stl: is an input file", "--report")
    assert model.read_bytes() == BOX.read_bytes()


def test_endless_gcode_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "zero.gcode").open("wb") as file:
        file.truncate(1 << 40)

    assert is_message(typed("dry-run", tmp_path / "zero.gcode"), "longer than 512 MiB")


def test_an_obj_that_is_no_text_is_refused_as_such(tmp_path: Path) -> None:
    (tmp_path / "odd.obj").write_bytes(np.random.default_rng(1).bytes(3000))
    outcome = typed("slice", tmp_path / "odd.obj", *QUICK)

    assert outcome.code == 3
    assert "pip install" not in outcome.err
