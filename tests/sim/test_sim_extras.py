"""Questions to a person, several extruders, babysteps, heat that plastic takes along, the timer of a USB chip."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_console import COLD_OK, Console

from printer_slicer.cli.simulator_options import FIRMWARES
from printer_slicer.sim.firmwares import MARLIN_2_1_ADVANCED, SIMULATED_FIRMWARES
from printer_slicer.sim.heater import Heater
from printer_slicer.sim.latency import PACKET_BYTES, LatencyTimer
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter

ASKED = [
    "//action:prompt_end",
    "//action:prompt_begin Nozzle Parked",
    "//action:prompt_button Continue",
    "//action:prompt_show",
]


def test_the_command_line_knows_every_firmware() -> None:
    assert tuple(SIMULATED_FIRMWARES) == FIRMWARES


@pytest.mark.parametrize("answer", ["M876 S0", "M108"])
def test_a_change_of_filament_asks_and_goes_on_when_the_button_is_pressed(answer: str) -> None:
    console = Console(MARLIN_2_1_ADVANCED)

    assert console.say("M600") == ["//action:paused", *ASKED]
    assert [line for _, line in console.wait(3.0)] == ["echo:busy: paused for user"]
    heard = console.say(answer)
    assert heard[:2] == ["//action:prompt_end", "//action:resumed"]
    assert [line.split()[0] for line in heard[2:]] == ["ok", "ok"]


def test_without_prompts_m876_is_unknown() -> None:
    assert Console().say("M876 S0") == ['echo:Unknown command: "M876 S0"', "ok"]


def test_the_display_is_told_to_a_host_with_prompts() -> None:
    assert Console(MARLIN_2_1_ADVANCED).say("M117 hello") == ["//action:notification hello", "ok P15 B3"]
    assert Console().say("M117 hello") == ["ok"]


# Extruders


def test_each_extruder_has_a_hotend_of_its_own() -> None:
    console = Console(machine=replace(Machine(), extruders=2))
    console.say("M104 T1 S150")
    console.wait(200.0)
    report = console.say("M105")[0]

    assert report.startswith(
        "ok T:21.00 /0.00 B:21.00 /0.00 T0:21.00 /0.00 T1:150.00 /150.00 @:0 B@:0 @0:0 @1:"
    )
    assert console.say("T1") == []
    assert [line for _, line in console.wait(5.0)] == ["echo:Active Extruder: 1", "ok"]
    assert console.say("M105")[0].startswith("ok T:150.00 ")
    assert console.say("T2") == ["echo:T2 Invalid extruder", "ok"]
    assert console.say("M104 T5 S20") == ["echo:M104 Invalid extruder 5", "ok"]


def test_only_the_extruder_in_use_has_to_be_warm() -> None:
    console = Console(machine=replace(Machine(), extruders=2, tool_change=0.0))
    console.do("M109 T1 S200")

    assert console.say("G1 E1") == ["echo: cold extrusion prevented", "ok"]
    console.do("T1")
    assert console.say("G1 E2") == ["ok"]


# Babysteps


def test_a_babystep_moves_the_nozzle_and_not_the_program() -> None:
    console = Console(machine=COLD_OK)
    console.do("G28", "G1 Z1 F300", "M290 Z0.05", "M83")

    assert console.say("M114")[0].startswith("X:0.00 Y:0.00 Z:1.00 ")
    console.do("G1 X10 E1", "M400")
    assert console.say("M114")[0].endswith("Z:420")
    assert console.printer.report().layers == (1.05,)
    assert console.say("M290") == ["ok"]
    console.do("G28", "G1 Z1", "G1 X20 E1", "M400")
    assert console.printer.report().layers == (1.05, 1.0)


# Heat


@given(
    target=st.floats(150.0, 260.0),
    flow=st.floats(0.0, 0.3),
    fan=st.floats(0.0, 1.0),
    fed=st.floats(1.0, 500.0),
)
def test_flowing_plastic_cools_and_never_by_more_than_power_and_loss_allow(
    target: float, flow: float, fan: float, fed: float
) -> None:
    spec = Machine().hotend
    warm = Heater(spec, 21.0)
    warm.set_fan(fan, 0.0)
    warm.set_target(target, 0.0)
    before = warm.temperature(3000.0)
    warm.flow_loss = flow
    after = warm.temperature(3000.0 + fed)
    # Where the controller gives all it has, or where what is missing makes up for what flows away.
    full = 21.0 + spec.power / (spec.loss + spec.fan_loss * fan + flow)
    least = min(before, full, target - flow * (target - 21.0) / (spec.power / 10.0))

    assert least - 1e-6 <= after <= before + 1e-6


@given(cuts=st.lists(st.floats(0.0, 500.0), max_size=6), flow=st.floats(0.0, 0.6))
def test_how_often_a_flow_is_looked_at_changes_nothing(cuts: list[float], flow: float) -> None:
    often, once = (Heater(Machine().hotend, 21.0) for _ in range(2))
    for heater in (often, once):
        heater.set_target(230.0, 0.0)
        heater.temperature(1000.0)
        heater.flow_loss = flow
    for cut in sorted(cuts):
        often.temperature(1000.0 + cut)

    assert often.temperature(1500.0) == pytest.approx(once.temperature(1500.0), abs=1e-6)


def test_extruding_cools_the_nozzle_a_little() -> None:
    console = Console()
    console.do("M109 S210", "M83", "M155 S2")
    console.wait(60.0)
    still = float(console.say("M105")[0].split()[1][2:])
    heard = console.do(*["G1 E10 F250"] * 12, "M400")
    least = min(float(line.split()[0][2:]) for line in heard if line.startswith(" T:"))

    # 10 mm³/s take 4.2 W, a tenth of what the heater has.
    assert still == pytest.approx(210.0, abs=0.05)
    assert 207.0 < least < 209.5
    assert not console.printer.report().killed


# The chip


@given(pieces=st.lists(st.tuples(st.floats(0.0, 0.05), st.binary(min_size=1, max_size=150)), max_size=20))
def test_a_chip_passes_every_byte_in_order_within_its_time(pieces: list[tuple[float, bytes]]) -> None:
    chip, now, came, sent = LatencyTimer(0.016), 0.0, b"", b""
    for pause, data in pieces:
        while chip.next_event_time() <= now + pause:
            came += chip.take_arrived_bytes(chip.next_event_time())
        now += pause
        chip.add_bytes(data, now)
        sent += data
        came += chip.take_arrived_bytes(now)
        assert len(sent) - len(came) < PACKET_BYTES
        assert sent == came or chip.next_event_time() <= now + 0.016 + 1e-9
    came += chip.take_arrived_bytes(now + 1.0)

    assert came == sent


def test_a_latency_timer_is_most_of_what_a_host_waits_for() -> None:
    def rate(timer: float) -> float:
        port = VirtualPort(SimulatedPrinter(Machine(), boots=False), baud=250_000, timer=timer)
        for _ in range(100):
            port.write(b"M117 a line of the usual length\n")
            while not port.read(1.0).endswith(b"\n"):
                pass
        return 100 / port.now()

    # One line for each tick of the timer, whatever the speed of the line.
    assert rate(0.016) == pytest.approx(1 / 0.016, rel=0.02)
    assert rate(0.0) > 500.0
