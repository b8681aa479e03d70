"""Damaged, lost, repeated and urgent lines, on firmwares that handle them differently."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from random import Random  # noqa: TID251 - seeded

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_console import Console, numbered

from printer_slicer.sim.firmwares import MARLIN_2_0_AVR, MARLIN_2_1, MARLIN_2_1_ADVANCED, SimulatedFirmware
from printer_slicer.sim.line_reader import checksum
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter

WRONG = ["Error:checksum mismatch, Last Line: 1", "Resend: 2", "ok"]
LATER = ["Error:Line Number is not Last Line Number+1, Last Line: 1", "Resend: 2", "ok"]
KILLED = ["echo:M112 Shutdown", "Error:Printer halted. kill() called!"]

QUICK_AVR = replace(MARLIN_2_0_AVR, seconds_per_line=0.0, seconds_per_byte=0.0)
"""The rules of the 8-bit board without its slowness, so that answers come at once."""


def spoilt(line: str) -> str:
    """The same line with a checksum that is wrong."""
    body, _, check = line.rpartition("*")
    return f"{body}*{int(check) ^ 1}"


def test_every_line_in_flight_behind_a_damaged_one_is_refused_when_nothing_is_flushed() -> None:
    console = Console()
    console.say(numbered(1, "G90"))

    heard = console.say(spoilt(numbered(2, "G90")), numbered(3, "G90"), numbered(4, "G90"))

    assert heard == WRONG + LATER + LATER
    assert console.printer.report().resends == 3


def test_lines_that_had_arrived_behind_a_damaged_one_are_gone_when_the_firmware_flushes() -> None:
    console = Console(QUICK_AVR)
    console.say(numbered(1, "G90"))

    heard = console.say(spoilt(numbered(2, "G90")), numbered(3, "G90"), numbered(4, "G90"))

    assert heard == WRONG
    assert console.printer.report().bytes_flushed > 0
    assert console.say(numbered(2, "G91")) == ["ok"]


def test_good_lines_around_a_damaged_one_are_answered_in_order() -> None:
    console = Console()
    console.say("M110 N8")
    bad = spoilt(numbered(11, "G90"))

    heard = console.say(
        *(numbered(n, "G90") for n in (9, 10)), bad, *(numbered(n, "G90") for n in (11, 12, 13))
    )

    assert heard == [
        "ok",
        "ok",
        "Error:checksum mismatch, Last Line: 10",
        "Resend: 11",
        "ok",
        "ok",
        "ok",
        "ok",
    ]


@pytest.mark.parametrize("repeat", [1, 2])
def test_the_older_firmware_answers_a_repeat_with_a_resend(repeat: int) -> None:
    console = Console(QUICK_AVR)
    console.say(numbered(1, "G90"))
    console.say(numbered(2, "G90"))

    assert console.say(numbered(repeat, "G90")) == [
        "Error:Line Number is not Last Line Number+1, Last Line: 2",
        "Resend: 3",
        "ok",
    ]
    assert console.executed == ["G90", "G90"]


def test_a_dropped_repeat_is_not_executed_and_counted() -> None:
    console = Console()
    console.say(numbered(1, "G90"), numbered(1, "G90"))

    assert console.executed == ["G90"]
    assert console.printer.report().repeats_dropped == 1


def test_a_resend_without_its_ok_where_the_firmware_has_none() -> None:
    console = Console(replace(MARLIN_2_1, ok_after_resend=False))

    assert console.say(numbered(7, "G90"))[1:] == ["Resend: 1"]


def test_too_much_at_once_overflows_the_small_buffer_in_silence_and_the_next_line_is_glued_to_a_stump() -> (
    None
):
    # Recorded from an ATmega2560: 40 lines of 37 bytes and newline pasted at 115200 Bd gave 22 oks.
    printer = SimulatedPrinter(Machine(), MARLIN_2_0_AVR, boots=False)
    port = VirtualPort(printer, baud=115_200)
    lines = [numbered(n, f"G1 X{n / 10:.4f} Y{n / 10:.4f} E0.00000 F30") for n in range(1, 41)]
    port.write("".join(f"{line}\n" for line in lines).encode())

    assert until(port, 100.0).splitlines() == ["ok"] * 22
    assert printer.report().bytes_lost > 0
    port.write(b"M114\n")
    assert until(port, 1.0).splitlines() == [
        "Error:No Checksum with line number, Last Line: 22",
        "Resend: 23",
        "ok",
    ]


def test_a_printer_with_flow_control_loses_nothing_however_much_comes_at_once() -> None:
    console = Console()
    lines = [numbered(n, f"G1 X{n / 10:.4f} F30") for n in range(1, 41)]

    heard = console.say(*lines) + [line for _, line in console.wait(100.0)]

    assert heard.count("ok") == 40
    assert len(console.executed) == 40


def test_what_a_flush_leaves_of_a_line_can_be_a_command_of_its_own_and_is_executed() -> None:
    # The error text takes 38 byte times to say; what arrives until then, line 3 and the beginning of line 4,
    # is thrown away with it. Where line 4 is cut depends on the length of line 3.
    executed: list[str] = []
    for padding in range(16):
        printer = SimulatedPrinter(Machine(), MARLIN_2_0_AVR, on_executed=executed.append, boots=False)
        port = VirtualPort(printer, baud=115_200)
        lines = numbered(1, "G21"), spoilt(numbered(2, "G90")), numbered(3, "M117 " + "x" * (8 + padding))
        port.write("".join(f"{line}\n" for line in (*lines, numbered(4, "G1 X10 Y10 F3000"))).encode())
        heard = until(port, 1.0)
        assert heard.startswith("ok\nError:checksum mismatch, Last Line: 1\nResend: 2\nok\n")
        if printer.report().unnumbered_moves:
            break
    else:
        pytest.fail("no stump began with G1")

    assert executed[-1] == "G1 X10 Y10 F3000"
    assert printer.report().unnumbered_moves == 1


def until(port: VirtualPort, seconds: float) -> str:
    """Everything heard in so many seconds."""
    end, heard = port.now() + seconds, b""
    while port.now() < end:
        heard += port.read(end - port.now())
    return heard.decode("latin-1")


def test_m112_kills_at_once_during_moves_and_leaves_silence() -> None:
    console = Console()
    console.do("M104 S200", "G1 X100 F600")
    console.wait(1.0)

    assert console.say("M112") == KILLED
    assert console.say("M105", "M999", numbered(1, "M110 N0")) == []
    assert console.printer.wakeup() is None
    assert console.printer.report().killed == "M112 Shutdown"


def test_m112_with_a_number_waits_for_its_turn() -> None:
    console = Console()
    console.say("G4 S5")

    assert console.say(numbered(1, "M112")) == []
    assert [line for _, line in console.wait(6.0)][-3:] == ["ok", *KILLED]


@pytest.mark.parametrize("line", ["M112", numbered(1, "M112"), " M112", "M112 ; stop"])
@pytest.mark.parametrize("bytewise", [False, True], ids=["whole", "bytewise"])
def test_the_emergency_parser_sees_m112_behind_anything(line: str, bytewise: bool) -> None:
    console = Console(MARLIN_2_1_ADVANCED, bytewise=bytewise)
    console.say("G4 S20", *["M117 x"] * 10)

    assert console.say(line) == [*KILLED, "//action:poweroff"]
    assert console.wait(30.0) == []


def test_without_emergency_parser_a_full_queue_hides_m112() -> None:
    console = Console()
    console.say("G4 S20", *["M117 x"] * 10)

    assert console.say("M112") == []
    assert [line for _, line in console.wait(30.0)][-2:] == KILLED


@pytest.mark.parametrize("firmware", [MARLIN_2_1, MARLIN_2_1_ADVANCED], ids=["plain", "emergency parser"])
def test_m108_ends_a_wait_and_is_answered_itself(firmware: SimulatedFirmware) -> None:
    console = Console(firmware)
    console.say("M109 S200")
    console.wait(3.0)

    heard = console.say("M108")

    assert [line.split()[0] for line in heard] == ["ok", "ok"]


def test_m410_stops_where_it_is() -> None:
    console = Console(MARLIN_2_1_ADVANCED)
    console.do("G1 X30 F600", "G1 X60", "G1 X90")
    console.wait(1.0)

    assert console.say("M410") == []
    assert console.wait(2.0)[0][0] == pytest.approx(1.0)
    place = console.say("M114")[0]
    assert 5.0 < float(place.split()[0][2:]) < 15.0
    assert console.printer.report().motion_seconds == pytest.approx(1.0, abs=0.11)


def test_m410_without_emergency_parser_acts_when_read_and_again_when_executed() -> None:
    console = Console()
    console.do("G1 X30 F600")
    console.wait(1.0)
    console.say("M410")

    assert [seconds for seconds, line in console.wait(5.0) if line == "ok"] == [pytest.approx(2.0)]


def test_a_move_that_waits_for_a_place_is_lost_with_m410() -> None:
    console = Console(MARLIN_2_1_ADVANCED)
    console.say(*[f"G1 X{n} F300" for n in range(1, 24)])
    console.wait(1.0)
    console.say("M410")
    console.wait(0.9)
    before = console.printer.report().motion_seconds
    console.wait(10.0)

    assert console.say("M114")[0].startswith("X:23.00 ")
    # Stopped at 5 mm; the moves from 6 to 20 mm were planned or waiting, those from 21 mm on only queued.
    assert before == pytest.approx(1.0, abs=0.01)
    assert console.printer.report().motion_seconds == pytest.approx(23.0 / 5.0, abs=0.02)


def test_a_reset_forgets_everything_but_the_warmth_and_the_account() -> None:
    console = Console()
    console.do("G28", "M109 R60", numbered(1, "G1 X50 F3000"))
    console.printer.reset(console.now)

    banner = console.heard()

    assert banner[0] == "start"
    assert console.say(numbered(2, "M105"))[1] == "Resend: 1"
    assert console.say(numbered(1, "M105"))[0].startswith("ok T:59.97 /0.00 ")
    assert console.say("M114")[0].startswith("X:0.00 ")
    report = console.printer.report()
    assert report.resets == 1
    assert report.lines == 5


@pytest.mark.parametrize("firmware", [MARLIN_2_1, MARLIN_2_1_ADVANCED, QUICK_AVR], ids=lambda x: x.name[:12])
def test_the_printer_survives_any_bytes(firmware: SimulatedFirmware) -> None:
    chance = Random(7)
    console = Console(firmware)
    for _ in range(400):
        noise = bytes(chance.choice(b"NGMTXYZEFIJRSP*;01239.- \n\r\xff\x00()") for _ in range(40))
        console.printer.receive(noise, console.now)
        console.now += 0.5
        console.heard()
        due = console.printer.wakeup()
        assert due is None or due > console.now
    console.printer.reset(console.now)
    console.heard()

    assert console.say("M118 alive")[0] == "alive"


@given(st.binary(max_size=128))
def test_the_checksum_is_all_bytes_joined_by_exclusive_or(data: bytes) -> None:
    expected = 0
    for byte in data:
        expected ^= byte

    assert checksum(data) == expected


LINES = st.lists(
    st.one_of(
        st.sampled_from(["M105", "", "; note", "G91", "M110 N3", "N1 M105", "M118 " + "y" * 120, "\rM31\r"]),
        st.integers(0, 5).map(lambda n: numbered(n, "G1 X1 F60")),
        st.integers(0, 5).map(lambda n: spoilt(numbered(n, "G90"))),
        # Without a 1 none of the commands that an emergency parser sees ahead of what arrived with them.
        st.text(alphabet="N023 *;GM.", max_size=12),
    ),
    max_size=12,
)


@given(
    lines=LINES,
    cuts=st.lists(st.integers(0, 600)),
    firmware=st.sampled_from([MARLIN_2_1, MARLIN_2_1_ADVANCED]),
)
def test_how_the_bytes_are_cut_changes_nothing(
    lines: list[str], cuts: list[int], firmware: SimulatedFirmware
) -> None:
    whole, cut = Console(firmware), Console(firmware)
    data = "".join(f"{line}\n" for line in lines).encode()
    whole.printer.receive(data, 0.0)
    edges = [0, *sorted(min(at, len(data)) for at in cuts), len(data)]
    for start, end in pairwise(edges):
        cut.printer.receive(data[start:end], 0.0)

    assert cut.heard() == whole.heard()
    assert cut.executed == whole.executed
    assert cut.printer.report() == whole.printer.report()
