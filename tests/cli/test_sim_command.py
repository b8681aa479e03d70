"""`sim` and `dry-run` with a firmware, faults and doors of one's choice."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from printer_slicer.cli import main
from tests.waiting import LAST_RESORT

ROOT = Path(__file__).parents[2]
GCODE = (
    "G28\nG90\nM83\nM104 S200\nM109 S200\n"
    + "".join(
        f"G1 X{20 + n % 50} Y{20 + n % 41} Z{0.2 * (1 + n // 100):.1f} E0.05 F6000\n" for n in range(300)
    )
    + "M104 S0\nM84\n"
)
SCRIPT = """
seed = 4
[[fault]]
kind = "flip"
rate = 2e-4
[[fault]]
kind = "hang"
line = 100
seconds = 2
"""


@pytest.fixture
def gcode(tmp_path: Path) -> Path:
    path = tmp_path / "part.gcode"
    path.write_text(GCODE)
    return path


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, object]]:
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_dry_run_with_faults_tells_them_and_can_be_had_again(
    gcode: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "bad.toml"
    script.write_text(SCRIPT)
    runs = [run_json(capsys, "dry-run", str(gcode), "--faults", str(script)) for _ in range(2)]
    other = run_json(capsys, "dry-run", str(gcode), "--faults", str(script), "--seed", "5")

    assert runs[0] == runs[1]
    assert [one["text"] for one in runs[0][1]["injected_faults"]] == [  # type: ignore[index, attr-defined]
        "flip both, 0.0002 of the bytes",
        "firmware hangs for 2 s",
    ]
    assert other[1]["total_seconds"] != runs[0][1]["total_seconds"]


def test_a_dry_run_that_a_fault_ends_fails_with_7(
    gcode: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    script = tmp_path / "bad.toml"
    script.write_text('[[fault]]\nkind = "disconnect"\nline = 150\n')

    assert main(["dry-run", str(gcode), "--faults", str(script)]) == 7
    said = capsys.readouterr()
    assert "the cable of the simulated printer was disconnected" in said.out
    assert "line 150: cable disconnected" in said.out


@pytest.mark.parametrize(
    "name", ["marlin 2.0", "MARLIN-2.1-ADVANCED", "klipper", "octoprint_virtual", "repetier"]
)
def test_a_dry_run_goes_through_on_other_firmwares(
    name: str, gcode: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, facts = run_json(capsys, "dry-run", str(gcode), "--firmware", name)

    assert facts["executed_equals_sent"] is True
    assert code in (0, 7)  # what the verdict thinks of the file is not asked here


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--firmware", "marlyn"], "choose one of: marlin 1.1, marlin 2.0"),
        (["--faults", "nowhere.toml"], "nowhere.toml: the fault script cannot be read: No such file"),
        (["--seed", "3"], "--seed has no effect without --faults"),
    ],
)
def test_flags_that_make_no_sense_are_refused(
    arguments: list[str], said: str, gcode: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["dry-run", str(gcode), *arguments])
    except SystemExit as error:
        code = int(str(error.code))

    assert code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rfc2217"], "--rfc2217 has no effect without --tcp"),
        (["--tcp", "8888"], "is not HOST:PORT"),
        (["--tcp", "localhost:99999"], "is not HOST:PORT"),
        (["--tcp", "127.0.0.1:1", "--pty", "x"], "not allowed with"),
        (
            ["--tcp", "127.0.0.1:0", "--card", "nowhere.gcode"],
            "nowhere.gcode: the file for the SD card cannot be read: No such file",
        ),
    ],
)
def test_doors_that_make_no_sense_are_refused(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["sim", *arguments])
    except SystemExit as error:
        code = int(str(error.code))

    assert code == 2
    assert said in capsys.readouterr().err


NET = ("--tcp", "127.0.0.1:0")


def test_files_and_flags_that_cannot_be_are_refused_before_anybody_is_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults, large = tmp_path / "f.toml", tmp_path / "large.gcode"
    faults.write_bytes("# Störung".encode("latin-1"))
    with large.open("wb") as file:
        file.truncate((64 << 20) + 1)
    for arguments, said in (
        (
            ["--report", "-", "--json"],
            "--report - and --json cannot both go to stdout\n  Leave out one of them\n",
        ),
        (
            ["--faults", str(faults)],
            f"{faults}: the fault script is not UTF-8 text\n  Name a TOML file with --faults\n",
        ),
        (
            ["--card", str(large)],
            (
                f"{large}: the file is larger than the 64 MiB that the simulated SD card accepts\n"
                "  Name smaller files after --card\n"
            ),
        ),
    ):
        assert main(["sim", *NET, *arguments]) == 2
        assert capsys.readouterr().err == f"printer-slicer: {said}"


@contextmanager
def served(*arguments: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """`sim` in a process of its own; the address it names."""
    process = subprocess.Popen(
        [sys.executable, "-m", "printer_slicer", "sim", "--speed", "0", *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        found = re.search(r" at (\S+);", process.stdout.readline())
        assert found is not None
        yield found[1], process
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=LAST_RESORT)


@pytest.mark.filterwarnings("ignore:set(Daemon|Name).*:DeprecationWarning")
@pytest.mark.skipif(sys.platform == "win32", reason="SIGTERM ends a process there")
@pytest.mark.parametrize("flag", [[], ["--rfc2217"]], ids=["raw", "rfc2217"])
def test_our_own_print_reaches_the_end_over_tcp_and_everything_is_executed(
    flag: list[str], gcode: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    report = tmp_path / "report.json"
    with served("--tcp", "127.0.0.1:0", *flag, "--expect", str(gcode), "--report", str(report)) as (
        address,
        _,
    ):
        assert address.startswith("rfc2217://" if flag else "socket://")
        assert main(["print", str(gcode), "--port", address, "-q"]) == 0
    facts = json.loads(report.read_text())

    assert facts["verdict"]["executed_equals_sent"] is True
    assert facts["job_commands"] == len(GCODE.splitlines())
    assert facts["line_errors"] == 0
