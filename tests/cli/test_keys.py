"""Keys that steer a print: what they mean, and a real terminal that is left as it was."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import pytest

from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

import pty
import termios

from printer_slicer.cli.keys import HELP, Keyboard
from printer_slicer.errors import UsageError
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.printing import Controls, commands
from printer_slicer.profile import load_profile
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve

ROOT = Path(__file__).parents[2]


class Heard(Controls):
    """Takes every command."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: list[commands.PrintCommand] = []

    def ask(self, command: commands.PrintCommand, timeout: float = 0.0) -> str:
        self.asked.append(command)
        if command == commands.Resume():
            raise UsageError("it cannot resume", remedy="wait")
        return "granted"

    def abort(self) -> None:
        self.asked.append(commands.Abort())


def pressed(keys: str, *, seconds_between: float = 0.1) -> tuple[list[commands.PrintCommand], list[str]]:
    controls, shown, now = Heard(), list[str](), [0.0]
    keyboard = Keyboard(controls, shown.append, lambda: now[0])
    for key in keys:
        now[0] += seconds_between
        keyboard.press(key)
    return controls.asked, shown


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ("p", [commands.Pause()]),
        ("n", [commands.Pause(now=True)]),
        ("s", [commands.Status()]),
        ("++-", [commands.Speed(105), commands.Speed(110), commands.Speed(105)]),
        ("<", [commands.Flow(95)]),
        ("ud", [commands.BabyStep(0.02), commands.BabyStep(-0.02)]),
        ("1", [commands.Answer(1)]),
        ("cc", [commands.Cancel()]),
        ("!!", [commands.Abort()]),
        ("c!c", []),
        (":M117 pX\x7f\x7fhi\r", [commands.Say("M117 hi")]),
        (":M500\x1bp", [commands.Pause()]),
        (":\r", []),
        ("xyz\x00é", []),
    ],
)
def test_keys_have_meanings(keys: str, wanted: list[commands.PrintCommand]) -> None:
    assert pressed(keys)[0] == wanted


def test_what_cannot_be_taken_back_is_pressed_twice_within_3_s() -> None:
    assert pressed("cc", seconds_between=4.0)[0] == []
    assert "again within 3 s" in pressed("!")[1][0]


def test_a_wish_that_is_refused_says_why() -> None:
    assert pressed("r")[1] == ["it cannot resume"]


def test_help_is_one_key_away() -> None:
    assert pressed("?")[1] == [HELP]


def test_a_real_terminal_pauses_goes_on_and_is_left_as_it_was(tmp_path: Path) -> None:
    printer = load_profile("marlin_220").printer
    executed: list[str] = []
    ready, stop = Flag(), Flag()

    def make() -> SimulatedPrinter:
        return SimulatedPrinter(
            machine_of(printer), simulated_firmware_for(printer), on_executed=executed.append
        )

    thread = Thread(
        target=lambda: serve(
            make, tmp_path / "port", speed=3.0, stop=stop.is_set, ready=lambda _: ready.set()
        )
    )
    thread.start()
    assert ready.wait(LAST_RESORT)
    lines = "G28\nG90\nG1 Z1 F600\n" + "".join(f"G1 X{10 + i % 60} Y9 F3000\n" for i in range(200))
    (tmp_path / "job.gcode").write_text(lines, encoding="utf-8")
    master, slave = pty.openpty()
    before = termios.tcgetattr(slave)
    env = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "PRINTER_SLICER_STATE": str(tmp_path / "state"),
        "TERM": "dumb",
    }
    command = [sys.executable, "-m", "printer_slicer", "print", "job.gcode", "--port", "port"]
    said = b""

    def hear(word: bytes) -> None:
        nonlocal said
        while word not in said:
            assert select.select([master], [], [], LAST_RESORT)[0], said
            said += os.read(master, 4096)
        said = said[said.index(word) + len(word) :]

    try:
        with subprocess.Popen(
            command, cwd=tmp_path, env=env, stdin=slave, stdout=slave, stderr=slave
        ) as host:
            hear(b"keys: p pause")
            until(lambda: any(line.startswith("G1 X") for line in executed))
            os.write(master, b"p")
            hear(b"paused")
            os.write(master, b"r")
            hear(b"resumed")
            os.write(master, b"+")
            hear(b"M220 S105")
            hear(b"done:")
            assert host.wait(LAST_RESORT) == 0
            assert termios.tcgetattr(slave) == before
    finally:
        os.close(master)
        os.close(slave)
        stop.set()
        thread.join(LAST_RESORT)
    assert "G1 X5 Y215 F6000" in executed
    assert "M220 S105" in executed
