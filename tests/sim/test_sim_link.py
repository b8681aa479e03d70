"""The cable: pace, delay and damage, under a clock that only moves when somebody waits."""

from __future__ import annotations

from random import Random  # noqa: TID251 - seeded

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_console import numbered

from printer_slicer.errors import PortError
from printer_slicer.sim.firmwares import MARLIN_2_0_AVR
from printer_slicer.sim.link import CableNoise, Direction, VirtualPort, Wire
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter


def port(**options: float) -> VirtualPort:
    return VirtualPort(SimulatedPrinter(Machine(), boots=False), **options)  # type: ignore[arg-type]


def test_time_moves_only_as_far_as_there_is_something_to_read() -> None:
    cable = port()
    cable.write(b"G4 S1\n")

    assert cable.now() == 0.0
    assert cable.read(10.0) == b"ok\n"
    assert cable.now() == pytest.approx(1.0)
    assert cable.read(0.5) == b""
    assert cable.now() == pytest.approx(1.5)
    assert cable.read(0.0) == b""
    assert cable.now() == pytest.approx(1.5)


def test_bytes_take_their_time_at_a_baud_rate_and_latency_comes_on_top() -> None:
    cable = port(baud=10_000, latency=0.25)
    cable.write(b"M117 x\n")

    heard = b""
    while not heard.endswith(b"\n"):
        heard += cable.read(1.0)

    # Ten bits for each of 7 bytes there and 3 back.
    assert cable.now() == pytest.approx((7 + 3) * 10 / 10_000 + 2 * 0.25)


@given(
    writes=st.lists(st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=20)), max_size=6),
    baud=st.one_of(st.none(), st.integers(100, 10_000)),
    looks=st.lists(st.floats(0.0, 3.0), max_size=20),
)
def test_a_wire_delivers_every_byte_once_in_order_and_never_early(
    writes: list[tuple[float, bytes]], baud: int | None, looks: list[float]
) -> None:
    wire = Wire(baud, 0.01)
    writes = sorted(writes, key=lambda write: write[0])
    for now, data in writes:
        wire.push(data, now)
    heard = b""
    for look in [*sorted(looks), 1e9]:
        while (part := wire.pop(look)) is not None:
            data, at = part
            heard += data
            assert at <= look
            assert len(heard) * wire.byte_seconds <= at

    assert heard == b"".join(data for _, data in writes)
    assert wire.pop(1e9) is None


@given(data=st.binary(min_size=1, max_size=60), baud=st.integers(100, 1_000_000), started=st.floats(0.0, 1e5))
def test_what_is_due_is_there(data: bytes, baud: int, started: float) -> None:
    wire = Wire(baud)
    wire.push(data, started)
    heard = b""
    while (due := wire.next_event_time()) < float("inf"):
        part = wire.pop(due)
        assert part is not None
        heard += part[0]

    assert heard == data


def test_the_8_bit_board_answers_as_many_lines_as_the_wire_carries_when_two_are_in_flight() -> None:
    def rate(window: int) -> float:
        cable = VirtualPort(SimulatedPrinter(Machine(), MARLIN_2_0_AVR, boots=False), baud=115_200)
        sent, heard = 0, b""
        while (answered := heard.count(b"ok\n")) < 300:
            while sent - answered < window:
                sent += 1
                cable.write(f"{numbered(sent, 'M117 ' + 'x' * 22)}\n".encode())
            heard += cable.read(1.0)
        return answered / cable.now()

    # Recorded: 251 lines/s with one in flight, 314 with two, 315 with more.
    one, two, four = rate(1), rate(2), rate(4)
    assert one == pytest.approx(251, rel=0.05)
    assert two == pytest.approx(315, rel=0.05)
    assert four == pytest.approx(two, rel=0.01)


def test_damage_hits_as_many_bytes_as_asked_for() -> None:
    noise = CableNoise(Random(1), flip=0.02, drop=0.01, insert=0.005)
    data = bytes(range(256)) * 100

    out = noise(data, "to printer")

    assert noise.flipped == pytest.approx(len(data) * 0.02, rel=0.2)
    assert noise.dropped == pytest.approx(len(data) * 0.01, rel=0.2)
    assert noise.inserted == pytest.approx(len(data) * 0.005, rel=0.3)
    assert len(out) == len(data) - noise.dropped + noise.inserted


def test_a_flip_changes_one_bit_and_no_damage_changes_nothing() -> None:
    data = b"G1 X1\n" * 50
    flipped = CableNoise(Random(2), flip=1.0)(data, "to host")

    assert [(a ^ b).bit_count() for a, b in zip(data, flipped, strict=True)] == [1] * len(data)
    assert CableNoise(Random(3))(data, "to host") == data


def test_the_same_seed_does_the_same_damage() -> None:
    first, second = (CableNoise(Random(9), flip=0.1, drop=0.1, insert=0.1) for _ in range(2))

    assert first(b"x" * 500, "to host") == second(b"x" * 500, "to host")


def test_damage_is_told_the_direction_and_done_to_both() -> None:
    seen: list[tuple[bytes, Direction]] = []

    def spoil(data: bytes, direction: Direction) -> bytes:
        seen.append((data, direction))
        return data.replace(b"ok", b"ko")

    cable = VirtualPort(SimulatedPrinter(Machine(), boots=False), noise=spoil)
    cable.write(b"M117\n")

    assert cable.read(1.0) == b"ko\n"
    assert seen == [(b"M117\n", "to printer"), (b"ok\n", "to host")]


def test_a_closed_port_neither_reads_nor_writes_and_a_new_one_goes_on_where_it_was() -> None:
    printer = SimulatedPrinter(Machine(), boots=False)
    cable = VirtualPort(printer)
    cable.write(b"G4 S5\n")
    assert cable.read(1.0) == b""
    cable.close()
    with pytest.raises(PortError):
        cable.write(b"M105\n")
    with pytest.raises(PortError):
        cable.read(1.0)

    again = VirtualPort(printer, started=cable.now())

    assert again.read(60.0) == b"echo:busy: processing\n"
    assert again.now() == pytest.approx(2.0)
