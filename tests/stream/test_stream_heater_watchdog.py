"""Heaters that are on while nobody hears the printer: alarms, warnings, last words. All on a clock that is told."""

from __future__ import annotations

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Identified, Message, Probe, Reading, Temperature
from printer_slicer.stream.heater_watchdog import HeaterAlarm, HeaterWatchdog, NoThermalProtection


def test_silence_is_an_alarm_only_while_something_is_hot() -> None:
    dog = HeaterWatchdog()
    assert dog.alarm_at == inf
    assert dog.check_silence(1e6) is None

    dog.on_sent(b"M104 S200", 5.0)
    assert dog.alarm_at == 15.0
    assert dog.check_silence(14.9) is None
    alarm = dog.check_silence(15.0)
    assert alarm == HeaterAlarm(10.0, (("T", 200.0),))
    assert (
        str(alarm) == "no answer from the printer for 10 s while heaters are on (T 200 °C): check the printer"
    )


def test_what_the_host_does_by_itself_is_no_sign_of_the_printer() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M104 S200", 5.0)
    dog.on_event(Probe(7), 9.0)
    assert dog.alarm_at == 15.0
    dog.on_event(Temperature((Reading("T", 180.0, None),)), 9.0)  # no target told: as it was
    assert (dog.alarm_at, dog.targets) == (19.0, {"T": 200.0})


def test_an_alarm_is_raised_once_for_each_silence() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M140 S60", 0.0)
    assert dog.check_silence(11.0) is not None
    assert (dog.alarm_at, dog.check_silence(500.0)) == (inf, None)

    dog.on_answer(501.0)
    assert dog.check_silence(505.0) is None
    assert dog.check_silence(511.0) == HeaterAlarm(10.0, (("B", 60.0),))


def test_answers_and_reports_put_it_off() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M190 S60", 0.0)
    for now in range(1, 100, 9):
        assert dog.on_event(Message("echo:busy: processing"), float(now)) is None
        assert dog.check_silence(now + 9.0) is None


def test_what_is_switched_off_is_not_watched_any_more() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M109 R210", 0.0)
    dog.on_sent(b"M140 S60", 0.0)
    dog.on_sent(b"M104 S0", 1.0)
    assert dog.targets == {"B": 60.0}
    dog.on_sent(b"M140 S0", 2.0)
    assert (dog.targets, dog.alarm_at) == ({}, inf)


def test_targets_are_learnt_from_reports_too() -> None:
    """A host that joins a running print, or a person at the display."""
    dog = HeaterWatchdog()
    dog.on_event(Temperature((Reading("T", 180.0, 210.0), Reading("B", 50.0, 60.0))), 3.0)
    assert dog.alarm_at == 13.0
    dog.on_event(Temperature((Reading("T", 180.0, 0.0), Reading("B", 50.0, 0.0))), 5.0)
    assert dog.alarm_at == inf


def test_tools_are_told_apart() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M104 T1 S200", 0.0)
    dog.on_sent(b"T0", 0.0)
    dog.on_sent(b"M104 S210", 0.0)
    assert dog.targets == {"T1": 200.0, "T0": 210.0}
    dog.on_event(
        Temperature((Reading("T", 20.0, 0.0), Reading("T0", 20.0, 0.0), Reading("T1", 20.0, 200.0))), 1.0
    )
    assert dog.targets == {"T1": 200.0}


def test_firmware_without_thermal_protection_is_worth_a_warning() -> None:
    dog = HeaterWatchdog()

    assert dog.on_event(Identified("Marlin", (("THERMAL_PROTECTION", False),)), 0.0) == NoThermalProtection(
        "Marlin"
    )
    assert dog.on_event(Identified("Marlin", (("THERMAL_PROTECTION", True),)), 0.0) is None
    assert dog.on_event(Identified("Marlin", ()), 0.0) is None
    assert "do not leave the printer unattended" in str(NoThermalProtection(""))


@pytest.mark.parametrize("firmware", SIMULATED_FIRMWARES)
def test_its_last_words_make_a_printer_cold_that_waits_for_heat(firmware: str) -> None:
    printer = SimulatedPrinter(Machine(), SIMULATED_FIRMWARES[firmware], boots=False)
    dog = HeaterWatchdog()
    for command in (b"M140 S60", b"M104 S200", b"M109 S200"):
        dog.on_sent(command, 1.0)
        printer.receive(command + b"\n", 1.0)
    printer.send(5.0)
    printer.receive(dog.build_shutdown_lines(), 5.0)
    # Not every firmware can be told to wait no longer.
    for now in range(6, 1000):
        printer.send(float(now))

    assert printer._state.hotend.target == printer._state.bed.target == 0.0


def test_last_words_name_what_was_ever_on_and_nothing_else() -> None:
    dog = HeaterWatchdog()
    dog.on_sent(b"M104 S0", 0.0)
    assert dog.build_shutdown_lines() == b""
    dog.on_sent(b"M104 S200", 0.0)
    dog.on_sent(b"M104 S0", 0.0)
    assert b"\nM104 S0\n" in dog.build_shutdown_lines()
    assert b"M140" not in dog.build_shutdown_lines()


def test_last_words_count_heaters_that_others_switched_on() -> None:
    """A resumed print: what was sent before is read from its journal."""
    dog = HeaterWatchdog()
    words = dog.build_shutdown_lines([b"G28", b"M190 S60", b"T1", b"M109 S200"])
    assert b"\nM140 S0\n" in words
    assert b"\nM104 T1 S0\n" in words


COMMANDS = st.sampled_from(
    [b"M104 S200", b"M104 S0", b"M140 S60", b"M140 S0", b"M109 T1 S210", b"G1 X5", b"T1"]
)


@given(st.lists(st.tuples(COMMANDS, st.floats(0, 20)), max_size=30))
def test_whatever_is_sent_the_alarm_comes_at_due_and_not_before(steps: list[tuple[bytes, float]]) -> None:
    dog, now = HeaterWatchdog(), 0.0
    for command, pause in steps:
        dog.on_sent(command, now)
        due = dog.alarm_at
        assert (due == inf) or dog.targets
        if due < inf:
            assert dog.check_silence(max(due - 1e-3, 0.0)) is None or due <= now
        now += pause
        alarm = dog.check_silence(now)
        assert (alarm is not None) == (due <= now)
        if alarm is None and pause < 5:
            dog.on_answer(now)
    for name in dog.targets:
        assert name[0].encode() in (b"T", b"B")
    assert dog.build_shutdown_lines().count(b" S0") >= 2 * len(dog.targets)


@pytest.mark.parametrize("command", [b"m104 s200", b"G10 P0 S200", b"M568 P0 S200"])
def test_every_way_to_heat_the_nozzle_is_switched_off(command: bytes) -> None:
    assert b"\nM104" in HeaterWatchdog().build_shutdown_lines([b"G28", command])
