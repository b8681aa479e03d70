"""Long work that nobody watches on a terminal tells how far it is."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from command_line import QUICK, heard, started, typed
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.killing import served
from printer_slicer.cli.output import Milestones
from printer_slicer.mesh_io import export_stl
from tests.parts import box
from tests.waiting import LAST_RESORT


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    steps=st.lists(st.tuples(st.integers(0, 40), st.floats(0, 70)), max_size=60), every_share=st.booleans()
)
def test_lines_come_with_each_share_and_after_each_minute_and_never_else(
    steps: list[tuple[int, float]], every_share: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    now, done, told_at, shares = 0.0, 0, 0.0, 0
    lines = Milestones("printing", wanted=True, every_share=every_share, clock=lambda: now)
    for more, seconds in steps:
        now, done = now + seconds, min(done + more, 400)
        capsys.readouterr()
        lines.report_if_due(done, 400, lambda: "there")
        said = capsys.readouterr().err
        due = now - told_at >= 60 or (every_share and done // 20 > shares)
        assert bool(said) == due
        if due:
            told_at, shares = now, done // 20
            assert said.startswith(f"printing: {done // 4} %, there, ")


def test_a_print_that_nobody_watches_tells_every_5_percent(tmp_path: Path) -> None:
    moves = "".join(f"G1 X{10 + i % 60} Y{10 + i % 7} F6000\n" for i in range(800))
    (tmp_path / "job.gcode").write_text("G28\nG90\nG1 Z1 F600\n" + moves, encoding="utf-8")
    with served(tmp_path / "port", 0.0):
        usual = typed("print", "job.gcode", "--port", "port", "--printer", "marlin_220", cwd=tmp_path)
        quiet = typed("print", "job.gcode", "--port", "port", "--printer", "marlin_220", "-q", cwd=tmp_path)
    percent = [
        int(number) for number in re.findall(r"^printing: (\d+) %, \d+ of 803 commands", usual.err, re.M)
    ]

    assert (usual.code, quiet.code, quiet.err) == (0, 0, "")
    assert percent[-1] == 100
    assert {number // 5 for number in percent} == set(range(1, 21))


def test_plans_that_are_compared_are_told_one_by_one(tmp_path: Path) -> None:
    export_stl(box((6.0, 6.0, 2.0)), tmp_path / "part.stl")
    usual = typed("plan", tmp_path / "part.stl", "--compare", *QUICK)
    quiet = typed("plan", tmp_path / "part.stl", "--compare", "-q", *QUICK)
    lines = usual.err.splitlines()
    plans = usual.out.count(" mm³ ", 0, usual.out.index("Certificate"))

    assert (usual.code, quiet.code, quiet.err) == (0, 0, "")
    assert len(lines) == plans - 1
    assert all(f" of {plans} plans done, next: " in line for line in lines)


def test_the_simulated_printer_lists_what_a_real_one_would_have_suffered(tmp_path: Path) -> None:
    cold = "G28\nG90\nM83\n" + "G1 X50 E1 F600\nG1 X60\n" * 30
    (tmp_path / "cold.gcode").write_text(cold, encoding="utf-8")
    with started("sim", "--pty", "port", "--speed", "0", "--printer", "marlin_220", cwd=tmp_path) as serving:
        heard(serving, b"ends it")
        flags = ("--printer", "marlin_220", "--allow", "cold", "--allow", "flow", "-q")
        printed = typed("print", "cold.gcode", "--port", "port", *flags, cwd=tmp_path)
        serving.send_signal(signal.SIGTERM)
        out, _ = serving.communicate(timeout=LAST_RESORT)
    first, *listed = out.decode().splitlines()
    count = int(re.findall(r"(\d+) violations", first)[0])

    assert printed.code == 0, printed.err
    assert count >= 30
    assert len([line for line in listed if re.match(r"  command \d+: .*G1 X50 E1", line)]) == 20
    assert listed[-1] == f"  and {count - 20} more: --report and --json list up to 1000"
