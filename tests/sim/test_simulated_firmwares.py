"""What each simulated firmware says, in conversations that follow its sources."""

from __future__ import annotations

from dataclasses import replace

import pytest
from sim_console import Console, numbered

from printer_slicer.sim.firmwares import (
    KLIPPER,
    MARLIN_1_1,
    MARLIN_2_0_BUFFERED,
    MARLIN_2_1_3,
    PRUSA_MK3,
    REPETIER,
    REPRAPFIRMWARE,
    SIMULATED_FIRMWARES,
    SMOOTHIE,
    SimulatedFirmware,
)
from printer_slicer.sim.line_reader import checksum


def prompt(firmware: SimulatedFirmware) -> SimulatedFirmware:
    """The same without the time that reading and speaking take."""
    return replace(firmware, seconds_per_line=0.0, seconds_per_byte=0.0)


def crc(number: int, command: str) -> str:
    """A line with a CRC, reckoned bit by bit."""
    body, value = f"N{number} {command}", 0
    for byte in body.encode():
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return f"{body}*{value:05d}"


def spoilt(line: str) -> str:
    return line.replace("G90", "G91")


CONVERSATIONS: dict[str, tuple[SimulatedFirmware, list[tuple[str, list[str]]]]] = {
    "Marlin 1.1": (
        MARLIN_1_1,
        [
            (numbered(1, "G90"), ["ok"]),
            (
                numbered(1, "G90"),
                ["Error:Line Number is not Last Line Number+1, Last Line: 1", "Resend: 2", "ok"],
            ),
        ],
    ),
    "Marlin 2.1.3 says its line number": (
        MARLIN_2_1_3,
        [
            ("M110", ["echo: M110 N0", "ok"]),
            (numbered(1, "G90"), ["ok"]),
            (numbered(1, "G90"), []),
            ("M110", ["echo: M110 N1", "ok"]),
        ],
    ),
    "Prusa MK3 refuses a checksum without a number": (
        PRUSA_MK3,
        [
            (numbered(1, "G90"), ["ok"]),
            ("G1 X10*33", ["Error:No Line Number with checksum, Last Line: 1", "Resend: 2", "ok"]),
            ("G90", ["ok"]),
        ],
    ),
    "RepRapFirmware drops a bad line without a word and takes any number": (
        REPRAPFIRMWARE,
        [
            (crc(5, "G90"), ["ok"]),
            (crc(5, "G90"), ["ok"]),
            (spoilt(crc(6, "G90")), []),
            (spoilt(numbered(6, "G90")), []),
            (numbered(9, "G90"), ["ok"]),
            ("N7 G90*x", []),
            ("G90", ["ok"]),
            ("; note", []),
        ],
    ),
    "Klipper looks at neither number nor checksum": (
        KLIPPER,
        [
            ("N99 G90*1", ["ok"]),
            ("M114", ["X:0.000 Y:0.000 Z:0.000 E:0.000", "ok"]),
            ("M105", ["ok B:21.0 /0.0 T0:21.0 /0.0"]),
            ("M115", ["ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:v0.12.0"]),
            ("M9999", ['// Unknown command:"M9999"', "ok"]),
            ("M112", ["// Klipper state: Shutdown", "ok"]),
        ],
    ),
    "Repetier says ok when it has read, and skips what it had": (
        REPETIER,
        [
            (numbered(1, "G90"), ["ok"]),
            (numbered(1, "G90"), ["skip 1", "ok"]),
            (numbered(4, "G90"), ["Error:expected line 2 got 4", "", "Resend:2", "ok"]),
            (numbered(5, "G90"), ["ok"]),
            (numbered(2, "M105"), ["ok", "T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0"]),
            ("G1 X10", ["Error:Missing linenumber", "", "Resend:3", "ok"]),
            (spoilt(numbered(3, "G90")), ["Error:Wrong checksum", "", "Resend:3", "ok"]),
        ],
    ),
    "Smoothie asks in two letters and says no ok": (
        SMOOTHIE,
        [
            (numbered(1, "G90"), ["ok"]),
            (numbered(3, "G90"), ["rs N2"]),
            (spoilt(numbered(2, "G90")), ["rs N2"]),
            (numbered(2, "G90"), ["ok"]),
        ],
    ),
}


@pytest.mark.parametrize("name", CONVERSATIONS)
def test_it_answers_as_its_sources_have_it(name: str) -> None:
    firmware, conversation = CONVERSATIONS[name]
    console = Console(prompt(firmware))

    for said, heard in conversation:
        assert console.say(said) == heard, said


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
def test_each_says_who_it_is(name: str) -> None:
    console = Console(prompt(SIMULATED_FIRMWARES[name]))

    heard = [line for line in console.say("M115") if "FIRMWARE_NAME:" in line]
    assert len(heard) == 1
    assert "{" not in heard[0]


def test_a_mk3_waits_two_seconds_for_the_rest_of_a_line() -> None:
    console = Console(prompt(PRUSA_MK3))
    console.printer.receive(b"N1 G9", console.now)

    assert console.wait(3.0) == [(2.0, "RX timeout")]
    assert console.say(numbered(1, "G90")) == ["ok"]


def test_a_mk3_says_that_its_buffer_was_full() -> None:
    console = Console(replace(PRUSA_MK3, seconds_per_byte=0.0))
    heard = console.say(*(numbered(n, "M117 " + "x" * 30) for n in range(1, 9)))
    heard += [line for _, line in console.wait(1.0)]

    assert "Full RX Buffer" in heard
    assert console.printer.report().bytes_lost > 0


def test_repetier_asks_five_times_a_second_for_a_line_that_does_not_come() -> None:
    console = Console(prompt(replace(REPETIER, wait_seconds=0.0)))
    console.printer.receive(b"N1 G9", console.now)
    heard = console.wait(1.1)

    assert [round(seconds, 2) for seconds, line in heard if line == "Resend:1"] == [0.2]
    console.say(numbered(3, "G90"))
    assert [line for _, line in console.wait(1.1)].count("Resend:1") == 5
    assert console.say(numbered(1, "G90")) == ["ok"]
    assert console.wait(1.0) == []


def test_a_transmit_buffer_lets_it_read_on_while_it_speaks() -> None:
    assert MARLIN_2_0_BUFFERED.seconds_per_byte == 0.0
    assert MARLIN_2_0_BUFFERED.flushes_on_error


def test_a_board_hears_nothing_while_it_boots() -> None:
    console = Console(replace(SMOOTHIE, boot_seconds=0.5))
    console.printer.reset(console.now)
    console.heard()

    assert console.say(numbered(1, "G90")) == []
    console.now += 0.5
    assert console.say(numbered(1, "G90")) == ["ok"]


def test_a_board_that_does_something_else_answers_later() -> None:
    console = Console()
    console.printer.hang(0.05, console.now)

    assert console.say("G90") == []
    assert console.wait(1.0) == [(pytest.approx(0.05), "ok")]


def test_the_checksum_is_the_same_however_long_the_line() -> None:
    assert checksum(b"x" * 255) == ord("x")
