"""Conversations recorded from real Marlin; the simulated printer says the same."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sim_console import Console, numbered

from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter

ROOM = "T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0"

CONVERSATIONS: dict[str, list[tuple[str, list[str]]]] = {
    "numbers and checksums": [
        ("N0 M110 N0*125", ["ok"]),
        ("N1 M105*38", [f"ok {ROOM}"]),
        ("N2 G90*18", ["ok"]),
        ("N3 G1 X10 F3000*54", ["Error:checksum mismatch, Last Line: 2", "Resend: 3", "ok"]),
        ("N3 G1 X10 F3000*55", ["ok"]),
        ("N4 M105*35", [f"ok {ROOM}"]),
        ("N5 M83*29", ["ok"]),
        (
            "N7 M105*32",
            ["Error:Line Number is not Last Line Number+1, Last Line: 5", "Resend: 6", "ok"],
        ),
    ],
    "a repeat of the last two numbers is dropped, a third back is refused": [
        (numbered(0, "M110 N4"), ["ok"]),
        (numbered(5, "G90"), ["ok"]),
        (numbered(6, "G90"), ["ok"]),
        (numbered(6, "G90"), []),
        (numbered(5, "G90"), []),
        ("N4 M105*35", ["Error:Line Number is not Last Line Number+1, Last Line: 6", "Resend: 7", "ok"]),
    ],
    "checksum without number and number without checksum": [
        ("M110 N7", ["ok"]),
        ("N8 M105", ["Error:No Checksum with line number, Last Line: 7", "Resend: 8", "ok"]),
        ("M105*83", [f"ok {ROOM}"]),
        ("M105*1", [f"ok {ROOM}"]),
        ("N8 M105 ; note*52", ["Error:No Checksum with line number, Last Line: 7", "Resend: 8", "ok"]),
    ],
    "M110 in all its forms": [
        ("M110 N99", ["ok"]),
        (numbered(100, "G90"), ["ok"]),
        ("N50 M110*22", ["ok"]),
        (numbered(51, "G90"), ["ok"]),
        ("N3 M110 N20*76", ["ok"]),
        (numbered(21, "G90"), ["ok"]),
        ("N-1 M110 N-1*125", ["ok"]),
        (numbered(0, "G90"), ["ok"]),
    ],
    "unknown commands": [
        (text, [f'echo:Unknown command: "{text}"', "ok"])
        for text in ("M9999", "G9999", "FOO", "X10", "g4 p0", "M20", "M21", "M27", "M862.3 P MK3S", "\xe9")
    ],
    "lines without a command": [("", []), (" ", []), ("; note", []), ("\r", []), ("   ; note", [])],
    "loose writing": [
        ("   M105", [f"ok {ROOM}"]),
        ("M105 ; note", [f"ok {ROOM}"]),
        ("M105\r", [f"ok {ROOM}"]),
        ("G4 P0 (x)", ["ok"]),
        ("G4P0", ["ok"]),
    ],
    "questions": [
        ("M114", ["X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", "ok"]),
        ("M114 D", ["X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", "ok"]),
        ("G92 E0", ["X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", "ok"]),
        ("M119", ["Reporting endstop status", "x_min: open", "y_min: open", "z_min: open", "ok"]),
        ("M113", ["echo:M113 S2", "ok"]),
        ("M220", ["FR:100%", "ok"]),
        ("M221", ["echo:E0 Flow: 100%", "ok"]),
        ("M31", ["echo:Print time: 0s", "ok"]),
        ("M302", ["echo:Cold extrudes are disabled (min temp 170C)", "ok"]),
        (
            "M211",
            ["echo:Soft endstops: On  Min:  X0.00 Y0.00 Z0.00   Max:  X200.00 Y200.00 Z200.00", "ok"],
        ),
    ],
    "messages": [
        ("M117 x", ["ok"]),
        ("M118 hi", ["hi", "ok"]),
        ("M118 E1 hi", ["echo:hi", "ok"]),
        ("M118 A1 pause", ["// pause", "ok"]),
        ("M118 P0 hi there", ["hi there", "ok"]),
    ],
    "tools": [("T0", ["ok"]), ("T5", ["echo:T5 Invalid extruder", "ok"])],
    "cold extrusion": [("G1 X10 E1", ["echo: cold extrusion prevented", "ok"])],
    "settings": [
        (
            "M503 S0",
            [
                "  G21 ; (mm)",
                "  M92 X80.00 Y80.00 Z400.00 E500.00",
                "  M203 X300.00 Y300.00 Z5.00 E25.00",
                "  M201 X3000.00 Y3000.00 Z100.00 E10000.00",
                "  M204 P3000.00 R3000.00 T3000.00",
                "  M205 B20000.00 S0.00 T0.00 J0.01",
                "ok",
            ],
        ),
    ],
}


@pytest.mark.parametrize("bytewise", [False, True], ids=["whole", "bytewise"])
@pytest.mark.parametrize("name", CONVERSATIONS)
def test_the_printer_answers_like_marlin(name: str, bytewise: bool) -> None:
    console = Console(bytewise=bytewise)

    for line, answer in CONVERSATIONS[name]:
        assert (line, console.say(line)) == (line, answer)


@pytest.mark.parametrize("bytewise", [False, True], ids=["whole", "bytewise"])
def test_a_long_line_is_cut_to_95_bytes(bytewise: bool) -> None:
    console = Console(bytewise=bytewise)

    assert console.say("M118 " + "x" * 200) == ["x" * 90, "ok"]


@pytest.mark.parametrize("bytewise", [False, True], ids=["whole", "bytewise"])
def test_a_numbered_line_that_is_too_long_never_gets_through(bytewise: bool) -> None:
    console = Console(bytewise=bytewise)
    line = numbered(1, "G1 X1." + "0" * 100)

    answer = ["Error:No Checksum with line number, Last Line: 0", "Resend: 1", "ok"]
    assert console.say(line) == answer
    assert console.say(line) == answer


def test_the_banner_is_said_once_by_a_printer_that_boots_and_never_by_one_that_runs() -> None:
    booting = SimulatedPrinter(Machine())
    running = SimulatedPrinter(Machine(), boots=False)

    assert booting.wakeup() == 0.0
    assert booting.send(0.0).splitlines()[0] == b"start"
    assert booting.send(1.0) == b""
    assert running.send(0.0) == b""
    assert running.wakeup() is None


def test_m115_tells_the_firmware_and_its_capabilities() -> None:
    plain, advanced = Console().say("M115"), Console(MARLIN_2_1_ADVANCED).say("M115")

    assert plain[0].startswith("FIRMWARE_NAME:Marlin bugfix-2.1.x ")
    assert plain[-1] == "ok"
    assert all(line.startswith("Cap:") and line[-2:] in (":0", ":1") for line in plain[1:-1])
    assert "Cap:EMERGENCY_PARSER:0" in plain
    assert "Cap:EMERGENCY_PARSER:1" in advanced
    assert advanced[-2] == (
        "area:{full:{min:{x:0.00,y:0.00,z:0.00},max:{x:200.00,y:200.00,z:200.00}},"
        "work:{min:{x:0.00,y:0.00,z:0.00},max:{x:200.00,y:200.00,z:200.00}}}"
    )


def test_ok_tells_number_and_free_places_when_the_firmware_is_built_so() -> None:
    console = Console(MARLIN_2_1_ADVANCED)

    assert console.say("M118 x") == ["x", "ok P15 B3"]
    assert console.say(numbered(1, "G90"), numbered(2, "M105")) == ["ok N1 P15 B3", f"ok {ROOM}"]
    assert console.say(numbered(3, "G1 X9 F60"), numbered(4, "G1 X8")) == ["ok N3 P14 B3", "ok N4 P13 B3"]
    assert console.say(numbered(9, "G90"))[-2:] == ["Resend: 5", "ok"]


def test_an_idle_printer_says_wait_only_when_it_is_built_so() -> None:
    console = Console(MARLIN_2_1_ADVANCED)

    assert console.wait(3.5) == [(1.0, "wait"), (2.0, "wait"), (3.0, "wait")]
    assert console.say("G90") == ["ok P15 B3"]
    assert console.wait(1.5) == [(1.0, "wait")]
    assert Console().wait(100.0) == []


def test_a_dwell_is_answered_when_it_is_over_and_busy_every_two_seconds() -> None:
    console = Console()

    assert console.say("G4 S5") == []
    assert console.wait(6.0) == [(2.0, "echo:busy: processing"), (4.0, "echo:busy: processing"), (5.0, "ok")]
    assert console.say("G4 P500") == []
    assert console.wait(1.0) == [(0.5, "ok")]
    assert console.printer.report().dwell_seconds == pytest.approx(5.5)


def test_m113_changes_how_often_busy_is_said() -> None:
    console = Console()
    console.say("M113 S1", "G4 S2.5")
    assert [seconds for seconds, _ in console.wait(3.0)] == [1.0, 2.0, 2.5]

    console.say("M113 S0", "G4 S5")
    assert console.wait(6.0) == [(5.0, "ok")]


def test_temperatures_are_reported_by_themselves_when_asked_for() -> None:
    console = Console()

    assert console.say("M155 S1") == ["ok"]
    assert console.wait(2.5) == [(1.0, f" {ROOM}"), (2.0, f" {ROOM}")]
    assert console.say("M155 S0") == ["ok"]
    assert console.wait(10.0) == []


def test_homing_takes_its_time_says_busy_and_then_where_it_is() -> None:
    console = Console()
    console.do("G1 X100 Y50 Z8 F3000", "M400")
    assert console.say("G28") == []

    heard = console.wait(60.0)

    # x 100 mm and y 50 mm at 50 mm/s, z 8 mm at 4 mm/s, and three times 1.5 s to touch again.
    assert [line for _, line in heard[-2:]] == ["X:0.00 Y:0.00 Z:0.00 E:0.00 Count X:0 Y:0 Z:0", "ok"]
    assert [seconds for seconds, _ in heard[-2:]] == pytest.approx([9.5, 9.5])
    assert [line for _, line in heard[:-2]] == ["echo:busy: processing"] * 4
    assert console.say("M119")[1:4] == ["x_min: TRIGGERED", "y_min: TRIGGERED", "z_min: TRIGGERED"]


def test_g29_is_unknown_without_a_probe_and_takes_time_with_one() -> None:
    console = Console(machine=replace(Machine(), probe_points=9, probe_seconds=3.0))

    assert Console().say("G29") == ['echo:Unknown command: "G29"', "ok"]
    assert console.say("G29") == ["echo:Home XYZ First", "ok"]
    console.do("G28")
    began = console.now
    assert console.do("G29").count("echo:busy: processing") == 13
    assert console.now - began == pytest.approx(27.0)


def test_a_stored_mesh_is_known_where_there_is_a_probe() -> None:
    probing = Console(machine=replace(Machine(), probe_points=9))

    assert Console().say("M420 S1") == ['echo:Unknown command: "M420 S1"', "ok"]
    assert probing.say("M420 S1") == ["ok"]


def test_a_question_to_a_person_waits_for_m108_or_for_its_time() -> None:
    console = Console()

    assert console.say("M0") == []
    assert console.wait(3.0) == [(2.0, "echo:busy: paused for user")]
    assert console.say("M108") == ["ok", "ok"]
    assert console.say("M1 S3") == []
    assert console.wait(5.0)[-1] == (3.0, "ok")


def test_extended_commands_are_unknown_unless_the_front_end_ignores_them() -> None:
    line = "SET_PRESSURE_ADVANCE ADVANCE=0.05"

    assert Console().say(line) == [f'echo:Unknown command: "{line}"', "ok"]
    assert Console(replace(MARLIN_2_1, ignores_extended=True)).say(line) == ["ok"]


def test_the_print_timer_runs_between_m75_and_m77() -> None:
    console = Console()
    console.do("M75", "G4 S3725", "M77", "G4 S10")

    assert console.say("M31") == ["echo:Print time: 1h 2m 5s", "ok"]
