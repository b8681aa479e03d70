"""Host and simulated printer over a bad cable: every line runs exactly once and in order.

What the damage covers: of the bytes that one side writes at once, a line or two or an answer, at most one is hit,
in a share of such chunks that the seed chooses (2 to 20 %). A flip turns one of its eight bits, a drop leaves it
out. That is what the checksum, one exclusive or, can always see. Two hits in one line can cancel and pass it on
any firmware; no host can prevent that, so no test here asks for it. Bytes do not overtake each other, and a
firmware without flow control is fed at the speed that its own printing is paced by.
"""

from __future__ import annotations

import re
import threading
import time
from contextlib import closing
from dataclasses import dataclass, field, replace
from random import Random  # noqa: TID251 - seeded
from typing import TYPE_CHECKING

import pytest

from printer_slicer.sim.firmwares import MARLIN_2_0_AVR, MARLIN_2_1, MARLIN_2_1_ADVANCED, SimulatedFirmware
from printer_slicer.sim.link import CableNoise, Direction, VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.stream.events import (
    Event,
    Finished,
    Halted,
    Identified,
    Probe,
    ResendRequested,
    Temperature,
)
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.serial_port import open_port
from printer_slicer.stream.session import run
from printer_slicer.stream.states import State
from tests.effort import crossed, few_of
from tests.waiting import LAST_RESORT

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

MACHINE = replace(Machine(), coldest_extrusion=0.0)
SIMULATED_FIRMWARES = {"2.1": MARLIN_2_1, "2.0 AVR": MARLIN_2_0_AVR, "2.1 advanced": MARLIN_2_1_ADVANCED}
OURS = {"M105", "M110 N0", "M115", "M400", "M114"}
"""What the host asks by itself; jobs here have none of it."""

COMMAND = re.compile(r"[GMT]\d")


@dataclass
class Print:
    """One print on a simulated printer with an invented clock."""

    job: Sequence[bytes]
    firmware: SimulatedFirmware = MARLIN_2_1
    damage: Callable[[bytes, Direction], bytes] | None = None
    baud: int | None = 115_200
    latency: float = 0.001
    window_lines: int = 2
    knows_limits: bool = True
    events: list[Event] = field(default_factory=list)
    executed: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.printer = SimulatedPrinter(MACHINE, self.firmware, on_executed=self.executed.append)
        self.port = VirtualPort(self.printer, baud=self.baud, latency=self.latency, noise=self.damage)
        limits = MACHINE.limits if self.knows_limits else None
        self.streamer = Streamer(self.job, limits=limits, window_lines=self.window_lines)

    def run(self, on_event: Callable[[Event], None] = lambda _: None) -> Print:
        def note(event: Event) -> None:
            self.events.append(event)
            on_event(event)

        run(self.streamer, self.port, self.port.now, on_event=note, longest_wait=60.0)
        return self

    @property
    def jobs_lines(self) -> list[str]:
        """The commands that were executed and that the host did not ask by itself, strays included."""
        return [line for line in self.executed if COMMAND.match(line) and line not in OURS]

    def count(self, *kinds: type) -> int:
        return sum(isinstance(event, kinds) for event in self.events)

    @property
    def end(self) -> Event:
        return self.events[-1]


class OneByte:
    """Hits at most one byte of each chunk; see the top of this file."""

    def __init__(self, chance: Random, share: float) -> None:
        self.hits = 0
        self._chance = chance
        self._share = share

    def __call__(self, data: bytes, _: Direction) -> bytes:
        if not data or self._chance.random() >= self._share:
            return data
        self.hits += 1
        at = self._chance.randrange(len(data))
        flipped = bytes([data[at] ^ 1 << self._chance.randrange(8)]) if self._chance.random() < 0.5 else b""
        return data[:at] + flipped + data[at + 1 :]


def random_job(chance: Random) -> list[bytes]:
    """60 to 200 lines, all moves different, so that one that is missing or doubled cannot hide."""
    places = [(chance.uniform(0, 200), chance.uniform(0, 200)) for _ in range(chance.randrange(53, 190))]
    moves = [b"G1 X%.3f Y%.3f E0.%03d F6000" % (x, y, i + 1) for i, (x, y) in enumerate(places)]
    return [b"G28", b"G90", b"M83", b"G92 E0", *moves, b"; the end", b"G1 E-1 F1800", b"M104 S0", b"M84"]


def wanted(job: Sequence[bytes]) -> list[str]:
    return [line.decode() for line in job if not line.startswith(b";")]


# Damage.


DAMAGED = [
    *crossed(range(60), ["2.1", "2.0 AVR"]),
    *(
        pytest.param(seed, name, marks=pytest.mark.thorough)
        for seed in range(60, 200)
        for name in ("2.1", "2.0 AVR")
    ),
]


@pytest.mark.parametrize(("seed", "name"), DAMAGED)
def test_every_line_runs_exactly_once_and_in_order(seed: int, name: str) -> None:
    chance = Random(seed)
    damage = OneByte(chance, share=(0.02, 0.05, 0.1, 0.2)[seed % 4])
    fast = 115_200 if name == "2.0 AVR" else chance.choice([115_200, 250_000, None])
    job = random_job(chance)
    bad = Print(
        job,
        SIMULATED_FIRMWARES[name],
        damage,
        baud=fast,
        latency=chance.choice([0.0, 0.001, 0.016]),
        knows_limits=seed % 3 != 0,
    ).run()

    assert bad.jobs_lines == wanted(job)
    assert isinstance(bad.end, Finished)
    assert bad.end.verified
    assert bad.end.acknowledged == len(job)


@pytest.mark.parametrize("seed", few_of(range(50), 12))
def test_it_also_does_on_firmware_that_numbers_its_oks(seed: int) -> None:
    chance = Random(seed)
    job = random_job(chance)

    bad = Print(job, MARLIN_2_1_ADVANCED, OneByte(chance, 0.1), knows_limits=seed % 2 == 0).run()

    assert bad.jobs_lines == wanted(job)


@pytest.mark.parametrize("seed", few_of(range(20), 8))
def test_it_also_does_on_firmware_that_says_no_ok_after_a_resend(seed: int) -> None:
    chance = Random(seed)
    job = random_job(chance)
    silent = replace(SIMULATED_FIRMWARES[("2.1", "2.0 AVR")[seed % 2]], ok_after_resend=False)

    bad = Print(job, silent, OneByte(chance, 0.05)).run()

    assert bad.jobs_lines == wanted(job)


@pytest.mark.parametrize("seed", few_of(range(20), 8))
def test_several_hits_in_a_line_never_lose_or_double_one(seed: int) -> None:
    chance = Random(seed)
    job = random_job(chance)

    bad = Print(job, MARLIN_2_1, CableNoise(chance, flip=1e-3, drop=5e-4, insert=5e-4)).run()

    assert isinstance(bad.end, Finished)
    assert len(bad.jobs_lines) == len(wanted(job))


@pytest.mark.parametrize("window_lines", [1, 2])
def test_one_bad_byte_costs_one_repeat_on_every_firmware(window_lines: int) -> None:
    for firmware in SIMULATED_FIRMWARES.values():
        hits = []

        def once(data: bytes, direction: Direction, hits: list[bytes] = hits) -> bytes:
            if direction == "to printer" and b"G1 X50 " in data and not hits:
                hits.append(data)
                return data.replace(b"G1 X50 ", b"G1 X51 ")
            return data

        job = [b"G28", b"G90", *(b"G1 X%d F6000" % i for i in range(20, 90))]
        bad = Print(job, firmware, once, window_lines=window_lines).run()

        assert bad.jobs_lines == wanted(job)
        assert bad.count(ResendRequested) == 1
        assert bad.count(Probe) == 0


# A clean cable.

LONG_JOB = [
    *(b"G28", b"G90", b"M83", b"M104 S200", b"M140 S60", b"M190 S60", b"M109 S200", b"G92 E0"),
    *(b"G1 X%d Y%d E0.2 F3000" % (20 + i % 2 * 100, 20 + i) for i in range(40)),
    b"G1 X100 Y100 F18",  # a few minutes for a few millimetres...
    b"G1 X190 Y190 F12.8",  # ...and ten for 127
    *(b"G1 X%d Y%d E0.2 F6000" % (20 + i % 50, 20 + i) for i in range(60)),
    *(b"G4 S40", b"G1 Z150 F6000", b"M117 done", b"M220 S50", b"G1 X5 F6000", b"M104 S0", b"M107"),
]


@pytest.mark.parametrize(
    ("name", "latency", "knows_limits"),
    crossed(SIMULATED_FIRMWARES, [0.0, 0.001, 0.016, 0.2], [True, False], laps=2),
)
def test_a_clean_cable_sees_no_repeat_and_no_question(name: str, latency: float, knows_limits: bool) -> None:
    clean = Print(LONG_JOB, SIMULATED_FIRMWARES[name], latency=latency, knows_limits=knows_limits).run()

    assert clean.jobs_lines == wanted(LONG_JOB)
    assert clean.count(ResendRequested, Probe) == 0
    assert isinstance(clean.end, Finished)
    assert clean.end.verified
    assert clean.port.now() > 900.0
    report = clean.printer.report()
    assert (report.line_errors, report.resends, report.repeats_dropped) == (0, 0, 0)


@pytest.mark.parametrize("knows_limits", [True, False])
def test_a_clean_cable_sees_no_question_from_a_printer_that_never_says_it_is_busy(knows_limits: bool) -> None:
    terse = replace(MARLIN_2_1, busy_seconds=0.0)

    clean = Print(LONG_JOB, terse, knows_limits=knows_limits).run()

    assert clean.jobs_lines == wanted(LONG_JOB)
    assert clean.count(ResendRequested, Probe) == 0


def test_a_printer_that_says_seldom_that_it_is_busy_is_not_sent_a_line_twice() -> None:
    seldom = replace(MARLIN_2_1, busy_seconds=20.0)

    clean = Print(LONG_JOB, seldom).run()

    assert clean.jobs_lines == wanted(LONG_JOB)
    assert clean.count(ResendRequested) == 0


def test_the_printer_says_who_it_is() -> None:
    (who,) = (e for e in Print([], MARLIN_2_1_ADVANCED).run().events if isinstance(e, Identified))

    assert who.firmware.startswith("Marlin bugfix-2.1.x")
    assert who.has_capability("EMERGENCY_PARSER")


# Lost and doubled answers.


def without_every(nth: int) -> Callable[[bytes, Direction], bytes]:
    """Loses every n-th ok."""
    seen = [0]

    def keep(match: re.Match[bytes]) -> bytes:
        seen[0] += 1
        return b"" if seen[0] % nth == 0 else match[0]

    return lambda data, way: data if way == "to printer" else re.sub(rb"ok[^\n]*\n", keep, data)


@pytest.mark.parametrize(("name", "most"), [("2.1", 2.0), ("2.0 AVR", 2.0), ("2.1 advanced", 0.01)])
def test_a_lost_ok_costs_less_than_two_seconds_and_nothing_if_oks_are_numbered(
    name: str, most: float
) -> None:
    job = [b"M117 line %d" % i for i in range(300)]
    clean = Print(job, SIMULATED_FIRMWARES[name]).run()
    lossy = Print(job, SIMULATED_FIRMWARES[name], without_every(50)).run()

    assert lossy.jobs_lines == wanted(job)
    lost = (len(job) + 4) // 50
    assert lossy.port.now() - clean.port.now() < lost * most


def test_doubled_oks_do_no_harm() -> None:
    job = random_job(Random(1))

    def double(data: bytes, way: Direction) -> bytes:
        return data if way == "to printer" else data.replace(b"ok\n", b"ok\nok\n")

    doubled = Print(job, MARLIN_2_1, double).run()

    assert doubled.jobs_lines == wanted(job)
    assert isinstance(doubled.end, Finished)


def test_noise_from_the_printer_does_no_harm() -> None:
    chance = Random(3)
    job = random_job(chance)

    def noise(data: bytes, way: Direction) -> bytes:
        return data if way == "to printer" or chance.random() < 0.9 else chance.randbytes(1000) + b"\n" + data

    noisy = Print(job, MARLIN_2_1, noise).run()

    assert noisy.jobs_lines == wanted(job)


# Silence, resets, a printer that stops.


@pytest.mark.parametrize(("knows_limits", "most"), [(True, 40.0), (False, 65.0)])
@pytest.mark.parametrize("way", ["to printer", "to host"])
def test_silence_for_ever_is_given_up(way: Direction, knows_limits: bool, most: float) -> None:
    cut_at: list[float] = []

    def cut(data: bytes, direction: Direction) -> bytes:
        return b"" if cut_at and direction == way else data

    silent = Print(random_job(Random(2)), MARLIN_2_1, cut, knows_limits=knows_limits)

    def pull(_: Event) -> None:
        if silent.streamer.acknowledged >= 30 and not cut_at:
            cut_at.append(silent.port.now())

    silent.run(pull)

    assert isinstance(silent.end, Halted)
    assert silent.end.reason == "the printer has stopped answering"
    assert 30.0 <= silent.port.now() - cut_at[0] < most
    assert silent.count(Probe) <= 6


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
@pytest.mark.parametrize("heard", [True, False])
def test_a_reset_printer_executes_nothing_more(name: str, heard: bool) -> None:
    def deaf(data: bytes, way: Direction) -> bytes:
        return data if way == "to printer" or heard or b"PowerUp" not in data or not reset else b""

    reset: list[tuple[float, int]] = []
    job = random_job(Random(4))
    broken = Print(job, SIMULATED_FIRMWARES[name], deaf)

    def brown_out(_: Event) -> None:
        if broken.streamer.acknowledged >= 40 and not reset:
            broken.printer.reset(broken.port.now())
            reset.append((broken.port.now(), len(broken.executed)))

    broken.run(brown_out)

    at, before = reset[0]
    assert isinstance(broken.end, Halted)
    assert "the printer was reset" in broken.end.reason
    assert 40 <= broken.end.acknowledged < len(job)
    assert not [line for line in broken.executed[before:] if line.startswith("G")]
    assert broken.port.now() - at < 5.0


def test_a_printer_that_kills_itself_ends_it_at_once() -> None:
    killed = Print([b"G28", b"G90", b"M112", b"G1 X10 F6000", b"G1 X20"]).run()

    assert isinstance(killed.end, Halted)
    assert "kill() called" in killed.end.reason
    assert "M112 Shutdown" in killed.end.reason
    assert killed.jobs_lines == ["G28", "G90", "M112"]


@pytest.mark.parametrize("seed", range(10))
def test_pausing_at_random_changes_nothing_of_what_is_executed(seed: int) -> None:
    chance = Random(seed)
    job = random_job(chance)
    halting = Print(job, MARLIN_2_1, OneByte(chance, 0.02))

    def pause_or_go_on(_: Event) -> None:
        wish = chance.random()
        if wish < 0.2:
            halting.streamer.pause()
        if wish > 0.6 or halting.streamer.state is State.PAUSED:
            halting.streamer.resume()

    halting.run(pause_or_go_on)

    assert halting.jobs_lines == wanted(job)


@pytest.mark.parametrize("name", SIMULATED_FIRMWARES)
def test_a_job_that_is_cancelled_while_it_heats_does_not_heat_on(name: str) -> None:
    heating = Print([b"G28", b"M109 S200", *random_job(Random(6))], SIMULATED_FIRMWARES[name])

    def cancel(event: Event) -> None:
        if isinstance(event, Temperature) and event.waiting:
            heating.streamer.cancel([b"M104 S0", b"M107"])

    heating.run(cancel)

    assert isinstance(heating.end, Finished)
    assert heating.end.cancelled
    assert heating.count(Probe, ResendRequested) == 0
    assert heating.executed[-5:] == ["M104 S0", "M107", "M400", "M105", "M114"]
    assert heating.port.now() < 20.0


# Speed, and the real thing.


def lines_per_second(firmware: SimulatedFirmware, window_lines: int) -> float:
    job = [b"M117 " + b"x" * 20] * 1000
    return len(job) / Print(job, firmware, window_lines=window_lines).run().port.now()


@pytest.mark.parametrize("name", ["2.1", "2.0 AVR"])
def test_two_lines_in_flight_fill_the_wire_at_115200_with_1_ms_of_latency(name: str) -> None:
    one, two = lines_per_second(SIMULATED_FIRMWARES[name], 1), lines_per_second(SIMULATED_FIRMWARES[name], 2)
    wire = 115_200 / 10 / len(b"N500 M117 xxxxxxxxxxxxxxxxxxxx*99\n")

    assert two >= 0.97 * wire
    assert 1.6 <= two / one <= 2.0


def test_a_job_prints_on_a_device_of_the_system(tmp_path: Path) -> None:
    executed: list[str] = []
    ready, stop = threading.Event(), threading.Event()
    server = threading.Thread(
        target=serve,
        args=(lambda: SimulatedPrinter(MACHINE, on_executed=executed.append), tmp_path / "printer"),
        kwargs={"speed": 0.0, "stop": stop.is_set, "ready": lambda _: ready.set()},
    )
    server.start()
    assert ready.wait(LAST_RESORT)
    job = random_job(Random(5))
    events: list[Event] = []
    try:
        with closing(open_port(str(tmp_path / "printer"))) as port:
            run(Streamer(job, limits=MACHINE.limits), port, time.monotonic, on_event=events.append)
    finally:
        stop.set()
        server.join(LAST_RESORT)

    assert isinstance(events[-1], Finished)
    assert events[-1].verified
    assert [line for line in executed if COMMAND.match(line) and line not in OURS] == wanted(job)
