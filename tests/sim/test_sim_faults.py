"""Planted faults: when they strike, what they do, that a run can be had again, and what is said of a bad script."""

from __future__ import annotations

import re
from dataclasses import replace
from math import inf
from random import Random  # noqa: TID251 - seeded

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_console import COLD_OK, numbered

from printer_slicer.errors import PortError, UsageError
from printer_slicer.sim.fault_script import read_script
from printer_slicer.sim.faults import KINDS, Fault, Faults
from printer_slicer.sim.firmwares import KLIPPER, MARLIN_2_1, SIMULATED_FIRMWARES, SimulatedFirmware
from printer_slicer.sim.link import VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.events import Event, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.session import run

MOVES = [b"G28", b"G90", b"M83"] + [
    b"G1 X%d Y%d Z%.1f E1 F6000" % (n % 50, n % 37, 0.2 * (1 + n // 50)) for n in range(200)
]


class Desk:
    """A printer with faults, its cable, and what was executed."""

    def __init__(
        self,
        *faults: Fault,
        seed: int = 1,
        machine: Machine = COLD_OK,
        firmware: SimulatedFirmware = MARLIN_2_1,
    ) -> None:
        self.executed: list[str] = []
        self.faults = Faults(faults, Random(seed))
        self.printer = SimulatedPrinter(
            machine, firmware, on_executed=self.executed.append, faults=self.faults, boots=False
        )
        self.port = VirtualPort(self.printer, baud=115_200, faults=self.faults)

    def print(self, *commands: bytes) -> Event:
        """Print, to the end, whichever it is."""
        events: list[Event] = []
        streamer = Streamer(commands or MOVES, limits=self.printer.state.machine.limits)
        run(streamer, self.port, self.port.now, on_event=events.append, longest_wait=60.0)
        return events[-1]

    @property
    def struck(self) -> list[tuple[int, str]]:
        return [(line, text) for _, line, text in self.faults.events]


def test_a_fault_strikes_at_its_line_once() -> None:
    desk = Desk(Fault("hang", line=100, seconds=3.0))

    assert isinstance(desk.print(), Finished)
    assert desk.struck == [(100, "firmware hangs for 3 s")]


def test_a_fault_strikes_at_its_layer_or_height_or_time() -> None:
    desk = Desk(
        Fault("clog", layer=2, seconds=1.0),
        Fault("clog", z=0.55, seconds=1.0),
        Fault("hang", time=2.5, seconds=0.1),
    )

    assert isinstance(desk.print(), Finished)
    told = {text: line for line, text in desk.struck}
    moments = [happening.time for happening in desk.faults.events]
    # Layers 2 and 3 begin with the moves 50 and 100; two lines of greeting and three of the job stand before.
    assert sorted(line for line, text in desk.struck if text.startswith("nozzle")) == [57, 107]
    assert "firmware hangs for 0.1 s" in told
    assert 2.5 in moments


@pytest.mark.parametrize("kind", ["flip", "drop", "insert", "duplicate"])
def test_damage_is_counted_and_the_print_is_exact_all_the_same(kind: str) -> None:
    desk = Desk(Fault(kind, rate=3e-4))

    assert isinstance(desk.print(), Finished)
    ours = [text.encode() for text in desk.executed if text.encode() in set(MOVES)]
    assert ours == MOVES


def test_bytes_are_changed_as_their_kind_says() -> None:
    def after(fault: Fault, data: bytes, way: str = "to printer") -> bytes:
        desk = Desk(fault)
        desk.printer.send(0.0)  # what is due at the beginning strikes
        return desk.faults(data, way)  # type: ignore[arg-type]

    assert after(Fault("drop", rate=1.0), b"abc") == b""
    assert after(Fault("duplicate", rate=1.0), b"abc") == b"aabbcc"
    assert after(Fault("drop", rate=1.0, count=2), b"abc") == b"c"
    assert after(Fault("drop", rate=1.0, direction="to host"), b"abc") == b"abc"
    assert len(after(Fault("insert", rate=1.0), b"abc")) == 6
    assert all(
        (a ^ b).bit_count() == 1 for a, b in zip(after(Fault("flip", rate=1.0), b"abc"), b"abc", strict=True)
    )
    assert after(Fault("lose_reply", count=1), b"ok T:1\nok\n", "to host") == b"ok\n"
    assert after(Fault("burst", bytes=50), b"abc").endswith(b"abc")
    assert len(after(Fault("burst", bytes=50), b"abc")) == 53


def test_lost_replies_are_got_over() -> None:
    desk = Desk(Fault("lose_reply", rate=0.05))

    assert isinstance(desk.print(), Finished)


def test_a_brown_out_ends_the_print_and_nothing_more_is_executed() -> None:
    desk = Desk(Fault("brown_out", line=60))

    assert isinstance(desk.print(), Halted)
    assert desk.printer.report().resets == 1
    assert sum(text.startswith("G1") for text in desk.executed) <= 60


def test_a_firmware_that_hangs_for_ever_is_given_up() -> None:
    desk = Desk(Fault("hang", line=60))
    end = desk.print()

    assert isinstance(end, Halted)
    assert desk.port.now() < 600.0


def test_a_pulled_cable_is_a_port_that_is_gone_and_may_come_back() -> None:
    desk = Desk(Fault("disconnect", line=60, seconds=5.0))

    with pytest.raises(PortError, match="disconnected"):
        desk.print()
    began = desk.port.now()
    with pytest.raises(PortError):
        desk.port.read(1.0)
    desk.printer.send(began + 6.0)
    desk.port = VirtualPort(desk.printer, started=began + 6.0, faults=desk.faults)
    desk.port.write(b"M118 here\n")
    assert b"here\nok\n" in desk.port.read(1.0)


def test_a_clog_feeds_and_lays_nothing() -> None:
    desk = Desk(Fault("clog", line=105, share=0.5))
    desk.print()
    report = desk.printer.report()

    # Move 100 is on line 105; it and those behind it lose half.
    assert report.filament_fed == pytest.approx(200.0)
    assert report.filament_missing == pytest.approx(50.0, abs=1.0)


def test_without_a_sensor_an_empty_spool_is_not_noticed() -> None:
    desk = Desk(Fault("runout", line=105))

    assert isinstance(desk.print(), Finished)
    report = desk.printer.report()
    assert report.runouts == 1
    assert report.filament_missing == pytest.approx(100.0, abs=2.0)


@pytest.mark.parametrize(("left", "spools"), [(120.0, 1), (80.0, 2)])
def test_with_a_sensor_the_filament_is_changed_whenever_it_ends(left: float, spools: int) -> None:
    machine = replace(COLD_OK, filament_left=left, runout_sensor=True, person_seconds=20.0)
    desk = Desk(machine=machine)

    assert isinstance(desk.print(), Finished)
    report = desk.printer.report()
    assert (report.runouts, report.filament_missing) == (spools, 0.0)
    assert desk.executed.count("M600") == spools


def test_an_endstop_that_never_closes_ends_in_a_halt() -> None:
    desk = Desk(Fault("endstop", axis="y"))
    end = desk.print(b"G28", b"G1 X10")

    assert isinstance(end, Halted)
    assert desk.printer.report().killed == "Homing Failed"


SAY_ONLY_THAT_THEY_STOPPED = {"reprapfirmware", "octoprint virtual"}


@pytest.mark.parametrize("name", sorted(set(SIMULATED_FIRMWARES) - SAY_ONLY_THAT_THEY_STOPPED))
def test_the_reason_of_a_stop_names_the_endstop_error(name: str) -> None:
    desk = Desk(Fault("endstop", axis="y"), firmware=SIMULATED_FIRMWARES[name])
    end = desk.print(b"M205 X8", b"G28", b"G1 X10")

    assert isinstance(end, Halted)
    assert re.search("Homing Failed|No trigger on y after full movement", end.reason), end
    assert "M205" not in end.reason


def test_klipper_leaves_the_machine_unhomed_after_an_endstop_error_and_goes_on_answering() -> None:
    printer = Desk(Fault("endstop", axis="y"), firmware=KLIPPER).printer
    printer.send(0.0)
    printer.receive(b"G28\nG1 X10\nM105\n", 0.0)
    said = b"".join(printer.send(second) for second in range(60)).decode().splitlines()

    assert said[0] == "!! No trigger on y after full movement"
    assert said[1] == "ok"
    assert said[2].startswith("!! Must home axis first")
    assert said[-1].startswith("ok B:")
    assert not any(printer.state.homed)


@pytest.mark.parametrize(
    ("fault", "why"),
    [
        (Fault("heater", state="off"), "Heating failed"),
        (Fault("heater", state="on"), "Err: MAXTEMP"),
        (Fault("sensor", temperature=-15.0), "Err: MINTEMP"),
        (Fault("sensor", temperature=999.0), "Err: MAXTEMP"),
        (Fault("sensor", temperature=120.0), "Heating failed"),
        (Fault("heater", state="off", time=400.0), "Thermal Runaway"),
        (Fault("heater", state="on", time=400.0), "Err: MAXTEMP"),
        (Fault("heater", heater="bed", state="off", time=600.0), "Thermal Runaway"),
    ],
    ids=str,
)
def test_a_heater_out_of_control_halts_the_firmware(fault: Fault, why: str) -> None:
    desk = Desk(fault, machine=Machine())
    end = desk.print(b"M140 S60", b"M104 S200", b"G4 S1500")

    assert isinstance(end, Halted)
    assert desk.printer.report().killed == why
    # It cools from then on, unless its switch does not open.
    now = desk.port.now()
    heater = desk.printer.state.heaters.find_heater(fault.heater)
    before = heater.temperature(now)
    warmer = heater.temperature(now + 60.0) > before
    assert warmer == (fault.kind == "heater" and fault.state == "on")


def test_a_heater_that_is_mended_in_time_is_no_reason_to_halt() -> None:
    desk = Desk(Fault("heater", state="off", time=400.0, seconds=15.0), machine=Machine())

    assert isinstance(desk.print(b"M104 S200", b"G4 S1000"), Finished)


def test_a_heater_that_the_machine_does_not_have_can_do_nothing() -> None:
    assert isinstance(Desk(Fault("heater", heater="E5")).print(b"M104 S50"), Finished)


def test_klipper_shuts_down_and_goes_on_answering() -> None:
    faults = Faults([Fault("sensor", temperature=999.0)], Random(1))
    printer = SimulatedPrinter(Machine(), KLIPPER, faults=faults, boots=False)
    printer.receive(b"M104 S200\n", 0.0)
    heard = [printer.send(now).decode() for now in (0.0, 0.5, 1.5)]
    printer.receive(b"M105\nG28\n", 2.0)
    heard.append(printer.send(2.0).decode())

    assert "// Klipper state: Shutdown" in "".join(heard)
    assert heard[-1].startswith("ok B:")
    assert "!! " in heard[-1]


SCRIPTS = st.lists(
    st.one_of(
        st.builds(
            Fault, kind=st.sampled_from(["flip", "drop", "insert", "duplicate"]), rate=st.floats(0.0, 0.002)
        ),
        st.builds(Fault, kind=st.just("lose_reply"), rate=st.floats(0.0, 0.1)),
        st.builds(Fault, kind=st.just("hang"), line=st.integers(1, 150), seconds=st.floats(0.0, 9.0)),
        st.builds(Fault, kind=st.sampled_from(["brown_out", "burst", "runout"]), line=st.integers(1, 150)),
        st.builds(Fault, kind=st.just("clog"), layer=st.integers(1, 4), seconds=st.floats(0.1, 9.0)),
    ),
    max_size=4,
)


@given(faults=SCRIPTS, seed=st.integers(0, 99))
def test_the_same_seed_and_faults_make_the_same_run(faults: list[Fault], seed: int) -> None:
    def run_once() -> tuple[object, ...]:
        desk = Desk(*faults, seed=seed)
        end = desk.print(*MOVES[:80])
        return desk.executed, end, desk.port.now(), desk.faults.events, desk.printer.report()

    assert run_once() == run_once()


def test_another_seed_makes_another_run() -> None:
    runs = []
    for seed in (1, 2):
        desk = Desk(Fault("flip", rate=1e-3), seed=seed)
        desk.print()
        runs.append(desk.port.now())

    assert runs[0] != runs[1]


def test_a_printer_without_faults_that_come_due_behaves_as_without_any() -> None:
    plain = SimulatedPrinter(COLD_OK, MARLIN_2_1, boots=False)
    reports = []
    for printer, faults in ((plain, None), (Desk(Fault("hang", line=10**6)).printer, None)):
        port = VirtualPort(printer, baud=115_200, faults=faults)
        run(Streamer(MOVES, limits=COLD_OK.limits), port, port.now, longest_wait=60.0)
        reports.append((printer.report(), port.now()))

    assert reports[0] == reports[1]


# Scripts

GOOD = """
seed = 7
[[fault]]
kind = "flip"
rate = 1e-4
way = "to printer"
[[fault]]
kind = "hang"
line = 1500
seconds = 5
[[fault]]
kind = "sensor"
heater = "bed"
temperature = 300
z = 2.4
"""


def test_a_script_becomes_faults() -> None:
    faults, seed = read_script(GOOD, "x.toml")

    assert seed == 7
    assert faults == [
        Fault("flip", rate=1e-4, direction="to printer"),
        Fault("hang", line=1500, seconds=5),
        Fault("sensor", heater="bed", temperature=300, z=2.4),
    ]
    assert faults[0].seconds == inf
    assert read_script("", "x.toml") == ([], None)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_can_be_written_down(kind: str) -> None:
    more = {"heater": 'state = "on"', "sensor": "temperature = 1"}.get(
        kind, "rate = 0.5" if kind in ("flip", "drop", "insert", "duplicate") else ""
    )

    assert read_script(f'[[fault]]\nkind = "{kind}"\ntime = 1.5\n{more}', "x")[0][0].kind == kind


@pytest.mark.parametrize(
    ("text", "wrong", "remedy"),
    [
        ("seed = ", "x.toml is not TOML: line 1: Invalid value", "Check that line"),
        ("sed = 1", "x.toml: unknown key sed", "Did you mean seed?"),
        ('seed = "a"', "x.toml: seed is 'a', which is not an integer", "Use an integer"),
        ("fault = 3", "x.toml: fault is not a list", "[[fault]]"),
        ("[[fault]]", "x.toml: fault 1: kind is missing", "Kinds: flip"),
        ('[[fault]]\nkind = "flipp"', "x.toml: fault 1: unknown kind 'flipp'", "Did you mean flip?"),
        ('[[fault]]\nkind = ["flip"]', "x.toml: fault 1: unknown kind ['flip']", "Kinds:"),
        ('[[fault]]\nkind = "flip"', "x.toml: fault 1 (flip): rate is missing", "a number from 0 to 1"),
        ('[[fault]]\nkind = "flip"\nrate = 2', "x.toml: fault 1 (flip): rate is 2", "a number from 0 to 1"),
        ('[[fault]]\nkind = "flip"\nrate = nan', "x.toml: fault 1 (flip): rate is nan", "a number from"),
        (
            '[[fault]]\nkind = "hang"\nlin = 3',
            "x.toml: fault 1 (hang): unknown key lin",
            "Did you mean line?",
        ),
        ('[[fault]]\nkind = "hang"\nline = 3.5', "x.toml: fault 1 (hang): line is 3.5", "a whole number"),
        (
            '[[fault]]\nkind = "hang"\nline = 3\nz = 1',
            "x.toml: fault 1 (hang): line and z exclude each other",
            "Use only one",
        ),
        ('[[fault]]\nkind = "runout"\nrate = 1', "x.toml: fault 1 (runout): unknown key rate", "Known keys"),
        (
            '[[fault]]\nkind = "endstop"\naxis = "w"',
            "x.toml: fault 1 (endstop): axis is 'w'",
            '"x", "y", "z"',
        ),
    ],
)
def test_a_bad_script_is_refused_with_the_place_and_the_remedy(text: str, wrong: str, remedy: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_script(text, "x.toml")

    assert wrong in str(caught.value)
    assert remedy in caught.value.remedy


def test_lines_without_numbers_are_counted() -> None:
    faults = Faults([Fault("hang", line=3, seconds=1.0)], Random(1))
    printer = SimulatedPrinter(Machine(), faults=faults, boots=False)
    printer.receive(b"G90\nG91\nM117 a\nM117 b\n", 0.0)
    printer.send(0.0)
    printer.receive(f"{numbered(1, 'G90')}\n".encode(), 5.0)

    assert [one.line for one in faults.events] == [3]
