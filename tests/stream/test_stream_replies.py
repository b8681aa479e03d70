"""What each firmware says, and what remains of it after damage."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.stream.events import Action, Busy, Message, Reading, Temperature
from printer_slicer.stream.replies import (
    Capability,
    Garbled,
    Identity,
    LineError,
    Ok,
    Position,
    Reply,
    Resend,
    Started,
    Stopped,
    UnknownCommand,
    Wait,
    parse_replies,
)

MARLIN_ERROR = "Error:Line Number is not Last Line Number+1, Last Line: 5"
PLACE = "X:0.00 Y:50.00 Z:0.20 E:0.00 Count X:0 Y:4000 Z:80"
KILLED = "Error:Printer halted. kill() called!"


def readings(*values: tuple[str, float, float | None]) -> tuple[Reading, ...]:
    return tuple(Reading(*value) for value in values)


SAID: dict[str, tuple[Reply, ...]] = {
    "ok": (Ok(),),
    "  ok": (Ok(),),
    "ok N5 P15 B3": (Ok(5, planner=15, places=3),),
    "ok P15 B3": (Ok(planner=15, places=3),),
    "ok 12": (Ok(),),
    "ok N1x P15 B3": (Ok(),),
    "Resend: 3": (Resend(3),),
    "Resend:3": (Resend(3),),
    "rs N2 Expected checksum 5": (Resend(2),),
    "Resend: 12ok": (Resend(12), Ok()),
    MARLIN_ERROR: (LineError(6, MARLIN_ERROR),),
    "Error: expected line 5 got 3": (LineError(5, "Error: expected line 5 got 3"),),
    "ok\v" + MARLIN_ERROR: (Ok(), LineError(6, MARLIN_ERROR)),
    "wait": (Wait(),),
    "start": (Started(),),
    "echo:busy: processing": (Busy("processing"),),
    "echo:busy: paused for user": (Busy("paused for user"),),
    KILLED: (Stopped(KILLED),),
    "!! Must home axis first": (Stopped("!! Must home axis first"),),
    "// Klipper state: Ready": (Started(),),
    "// Klipper state: Disconnect": (Stopped("// Klipper state: Disconnect"),),
    "//action:pause": (Action("pause"),),
    "// action:notification Hello": (Action("notification Hello"),),
    'echo:Unknown command: "M9999"': (UnknownCommand(b"M9999", 'echo:Unknown command: "M9999"'),),
    "FIRMWARE_NAME:Marlin 2.1 (Nov 21) SOURCE_CODE_URL:x PROTOCOL_VERSION:1.0": (
        Identity("Marlin 2.1 (Nov 21)"),
    ),
    "ok FIRMWARE_NAME:Klipper FIRMWARE_VERSION:?": (Identity("Klipper"), Ok()),
    "FIRMWARE_NAME:Virtual Marlin": (Identity("Virtual Marlin"),),
    "Cap:EMERGENCY_PARSER:1": (Capability("EMERGENCY_PARSER", True),),
    PLACE: (Position(0.0, 50.0, 0.2, PLACE, 0.0),),
    "ok X:10.0 Y:-1.5 Z:0.0 E:0.0": (Position(10.0, -1.5, 0.0, "X:10.0 Y:-1.5 Z:0.0 E:0.0", 0.0), Ok()),
    "ok T:19.37 /0.00 B:20.50 /60.00 @:0 B@:0": (
        Temperature(readings(("T", 19.37, 0.0), ("B", 20.5, 60.0))),
        Ok(has_temperatures=True),
    ),
    "ok B:65.9 /0.0 T0:204.3 /210.0": (
        Temperature(readings(("B", 65.9, 0.0), ("T0", 204.3, 210.0))),
        Ok(has_temperatures=True),
    ),
    "ok X:10.0 Y:0.0 Z:0.2 E:1.5 Count: A:1000 B:0 C:80": (
        Position(10.0, 0.0, 0.2, "X:10.0 Y:0.0 Z:0.2 E:1.5 Count: A:1000 B:0 C:80", 1.5),
        Ok(),
    ),
    "ok T:21.30/ 0.00 B:21.30/ 0.00 @:64": (
        Temperature(readings(("T", 21.3, 0.0), ("B", 21.3, 0.0))),
        Ok(has_temperatures=True),
    ),
    " T:52.44 /60.00 B:32.08 /40.00 @:38 B@:0 W:?": (
        Temperature(readings(("T", 52.44, 60.0), ("B", 32.08, 40.0)), waiting=True),
    ),
    "T:21.36": (Temperature(readings(("T", 21.36, None))),),
    "echo:cold extrusion prevented": (Message("echo:cold extrusion prevented"),),
    "FR:100%": (Message("FR:100%"),),
    "": (),
    "   ": (),
}


@pytest.mark.parametrize("said", SAID)
def test_an_answer_is_understood(said: str) -> None:
    assert parse_replies(said.encode()) == SAID[said]


@pytest.mark.parametrize(
    ("remains", "may_reject"),
    [
        ("k", False),
        ("o", False),
        ("okok", False),
        ("Resend: ", True),
        ("Resemd: 12", True),
        ("esend: 12", True),
        ("Rsend: 12", True),
        ("Resend: 1r", True),
    ],
)
def test_the_remains_of_an_answer_are_told_apart_from_text(remains: str, may_reject: bool) -> None:
    assert parse_replies(remains.encode()) == (Garbled(remains.strip(), may_reject),)


def test_bytes_that_are_no_text_are_remains_and_may_have_been_a_refusal() -> None:
    assert parse_replies(b"o\xeb") == (Garbled("o\ufffd", False),)
    assert parse_replies(b"\x90\x91\x92\x93\x94\x95") == (Garbled("\ufffd" * 6, True),)


@given(st.binary(max_size=200))
def test_no_bytes_at_all_are_too_much(line: bytes) -> None:
    for reply in parse_replies(line.replace(b"\n", b"")):
        assert reply is not None


@given(st.integers(1, 99999), st.data())
def test_one_byte_of_a_request_gone_never_makes_it_an_ok(number: int, data: st.DataObject) -> None:
    request = b"Resend: %d" % number
    index = data.draw(st.integers(0, len(request) - 1))
    replies = parse_replies(request[:index] + request[index + 1 :])

    assert not any(isinstance(reply, Ok | Message | Temperature) for reply in replies)
