"""Heaters: the lump of metal, and the commands that wait for it."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_console import Console

from printer_slicer.sim.heater import Heater, HeaterSpec
from printer_slicer.sim.machine import Machine

HOTEND = Machine().hotend
ROOM = 21.0

targets = st.floats(0.0, 260.0)
moments = st.lists(st.floats(0.0, 2000.0), min_size=1, max_size=8).map(sorted)


def heater(target: float = 0.0, spec: HeaterSpec = HOTEND) -> Heater:
    made = Heater(spec, ROOM)
    made.set_target(target, 0.0)
    return made


@given(target=targets, moments=moments)
def test_how_often_the_temperature_is_asked_for_changes_nothing(target: float, moments: list[float]) -> None:
    often, once = heater(target), heater(target)
    for moment in moments:
        often.temperature(moment)

    assert often.temperature(2000.0) == pytest.approx(once.temperature(2000.0), abs=1e-6)


@given(first=targets, target=targets, moment=st.floats(1.0, 500.0))
def test_a_new_target_counts_from_the_moment_it_is_set(first: float, target: float, moment: float) -> None:
    watched, unwatched = heater(first), heater(first)
    watched.temperature(moment)
    for one in (watched, unwatched):
        one.set_target(target, moment)

    assert unwatched.temperature(moment) == pytest.approx(watched.temperature(moment), abs=1e-6)
    assert unwatched.temperature(moment + 60) == pytest.approx(watched.temperature(moment + 60), abs=1e-6)


@given(target=targets, moments=moments)
def test_a_heater_never_overshoots(target: float, moments: list[float]) -> None:
    warm = heater(target)
    temperatures = [warm.temperature(moment) for moment in moments]

    assert temperatures == sorted(temperatures)
    assert temperatures[-1] <= max(target, ROOM) + 1e-9


@given(target=st.floats(30.0, 260.0), share=st.floats(0.01, 0.99), fan=st.floats(0.0, 1.0))
def test_the_moment_of_a_temperature_is_when_the_temperature_is_reached(
    target: float, share: float, fan: float
) -> None:
    warm = heater(target)
    warm.set_fan(fan, 0.0)
    wanted = ROOM + share * (target - ROOM)

    assert warm.temperature(warm.seconds_until(wanted, 0.0)) == pytest.approx(wanted, abs=1e-6)


@given(start=st.floats(60.0, 260.0), target=st.floats(0.0, 260.0), share=st.floats(0.01, 0.99))
def test_the_same_for_cooling_down(start: float, target: float, share: float) -> None:
    warm = heater(start)
    hot = warm.temperature(5000.0)
    warm.set_target(target, 5000.0)
    end = max(target, ROOM)
    wanted = hot + share * (end - hot)

    assert warm.temperature(5000.0 + warm.seconds_until(wanted, 5000.0)) == pytest.approx(wanted, abs=1e-5)


def test_a_temperature_on_the_other_side_is_never_reached() -> None:
    warm = heater(200.0)

    assert warm.seconds_until(20.0, 0.0) == inf
    assert warm.seconds_until(201.0, 0.0) == inf


def test_full_power_is_given_far_below_the_target_and_the_loss_is_replaced_at_it() -> None:
    warm = heater(200.0)

    assert warm.power_ratio(0.0) == 1.0
    assert warm.power_ratio(5000.0) == pytest.approx(HOTEND.loss * (200.0 - ROOM) / HOTEND.power)
    assert warm.peak == pytest.approx(200.0)


def test_a_heater_too_weak_for_its_target_ends_where_power_and_loss_balance() -> None:
    weak = heater(200.0, replace(HOTEND, power=10.0))

    assert weak.temperature(1e6) == pytest.approx(ROOM + 10.0 / HOTEND.loss)
    assert weak.seconds_until(150.0, 0.0) == inf


def test_the_fan_makes_heating_slower() -> None:
    calm, windy = heater(250.0), heater(250.0)
    windy.set_fan(1.0, 0.0)

    assert windy.seconds_until(240.0, 0.0) > calm.seconds_until(240.0, 0.0) * 1.05


def test_m104_is_answered_at_once_and_the_temperature_rises() -> None:
    console = Console()

    assert console.say("M104 S60") == ["ok"]
    assert console.say("M105") == ["ok T:21.00 /60.00 B:21.00 /0.00 @:127 B@:0"]
    console.wait(100.0)
    assert console.say("M105")[0].startswith("ok T:60.00 /60.00 ")


def test_m109_reports_every_second_and_waits_ten_seconds_within_the_window() -> None:
    console = Console()
    reaches = heater(60.0).seconds_until(59.0, 0.0)
    assert console.say("M109 S60") == [" T:21.00 /60.00 B:21.00 /0.00 @:127 B@:0 W:?"]

    heard = console.wait(100.0)

    assert heard[-1][0] == pytest.approx(reaches + 10.0)
    assert heard[-1][1] == "ok"
    reports = [(seconds, line.split(" W:")[1]) for seconds, line in heard if " W:" in line]
    assert [seconds for seconds, _ in reports] == pytest.approx(range(1, len(reports) + 1))
    assert [rest for _, rest in reports if rest != "?"] == [str(n) for n in range(9, -1, -1)]
    assert [rest for seconds, rest in reports if seconds < reaches] == ["?"] * int(reaches)
    busy = [seconds for seconds, line in heard if line == "echo:busy: processing"]
    assert busy == pytest.approx([2.0 * n for n in range(1, len(busy) + 1)])
    assert console.printer.report().heating_seconds == pytest.approx(reaches + 10.0)


def test_a_heater_that_is_at_its_target_is_not_waited_for() -> None:
    console = Console()
    console.do("M109 S60")

    assert console.say("M109 S60")[-1] == "ok"


def test_a_heater_whose_sensor_reads_the_target_is_not_waited_for() -> None:
    console = Console()
    heater = console.printer.state.hotend
    heater.set_fault(0.0, stuck_at=200.4)

    assert console.do("M109 S200") == ["ok"]
    assert heater.temperature(console.now) < 30.0
    assert console.do("M109 S180") == ["ok"]  # it seems too hot, and S waits for heating only


def test_a_dead_heater_that_cools_to_its_target_has_arrived() -> None:
    console = Console()
    console.do("M109 S200")
    console.printer.state.hotend.set_fault(console.now, element="off")
    console.do("M109 R100")

    assert console.printer.state.hotend.temperature(console.now) < 101.0


def test_s_does_not_wait_for_cooling_and_r_does() -> None:
    console = Console()
    console.do("M109 S100")

    assert console.say("M109 S50") == ["ok"]
    began = console.now
    console.do("M109 R50")
    assert console.now - began > 30.0
    assert console.say("M105")[0].startswith("ok T:50.")


def test_a_wait_for_cooling_below_the_room_gives_up() -> None:
    console = Console()
    console.do("M190 S60", "M190 R0", limit=20_000.0)

    temperature = float(console.say("M105")[0].split("B:")[1].split()[0])
    assert ROOM < temperature < 35.0


def test_m190_waits_for_the_bed() -> None:
    console = Console()
    console.do("M190 S60")

    assert 100.0 < console.now < 400.0
    assert float(console.say("M105")[0].split("B:")[1].split()[0]) == pytest.approx(60.0, abs=1.0)


def test_a_target_beyond_the_machine_is_lowered_and_noted() -> None:
    console = Console()
    console.say("M104 S400", "M140 S200")

    assert "/260.00" in console.say("M105")[0]
    assert "/140.00" in console.say("M105")[0]
    assert [violation.text for violation in console.printer.report().violations] == [
        "hotend target 400 °C is above the maximum of 260 °C: M104 S400",
        "bed target 200 °C is above the maximum of 140 °C: M140 S200",
    ]


def test_the_peaks_are_the_highest_temperatures_and_not_the_last() -> None:
    console = Console()
    console.do("M109 S200", "M104 S0")
    console.wait(3600.0)

    report = console.printer.report()
    assert report.peak_hotend == pytest.approx(200.0, abs=0.2)
    assert report.peak_bed == ROOM


def test_the_fan_cools_the_hotend() -> None:
    calm, windy = Console(), Console()
    windy.say("M106 S255")
    for console in (calm, windy):
        console.do("M109 S240")

    assert windy.now > calm.now + 1.0
    assert windy.say("M107") == ["ok"]
    assert windy.say("M106 P1 S255") == ["ok"]


def test_cold_extrusion_is_refused_until_it_is_warm_or_allowed() -> None:
    refused = ["echo: cold extrusion prevented", "ok"]
    console = Console()

    assert console.say("G1 E1") == refused
    console.say("M302 S0")
    assert console.say("G1 E2") == ["ok"]
    console.say("M302 S170")
    assert console.say("G1 E3") == refused
    console.say("M302 P1")
    assert console.say("G1 E4") == ["ok"]
    console.say("M302 P0")
    console.do("M109 S200")
    assert console.say("G1 E5") == ["ok"]
    console.do("M109 R100")
    assert console.say("G1 E6") == refused
    assert console.printer.report().filament == pytest.approx(3.0)


@pytest.mark.parametrize("command", ["M104", "M109", "M140", "M190", "M104 T0"])
def test_a_command_without_a_temperature_changes_nothing(command: str) -> None:
    console = Console()
    console.say("M104 S60", "M140 S50")

    assert console.say(command) == ["ok"]
    assert console.say("M105") == ["ok T:21.00 /60.00 B:21.00 /50.00 @:127 B@:127"]
