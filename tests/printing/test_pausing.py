"""Pausing and going on: the part comes out as if nobody had ever paused."""

from __future__ import annotations

from random import Random  # noqa: TID251 - seeded

import pytest
from printed import scribble, tower
from rig import Rig, assert_same_beads, off_path, way

from printer_slicer.printing import wishes
from printer_slicer.printing.phases import Phase
from printer_slicer.stream.events import Finished, Paused, Resumed


def printed(text: str) -> Rig:
    """A print that nobody disturbs."""
    rig = Rig(text)
    rig.connect()
    rig.run()
    return rig


def paused_at(text: str, entries: list[int], pause: wishes.Pause) -> Rig:
    """A print that is paused when so many commands were accepted, and goes on 3 s after it is parked."""
    rig = Rig(text)
    rig.connect()
    left, since = list(entries), [0.0]

    def turn(now: float) -> None:
        phase = rig.conductor.phase
        if phase is Phase.RUNNING and left and rig.streamer.acknowledged >= left[0]:
            left.pop(0)
            rig.wish(pause)
            since[0] = now
        elif phase is Phase.WAITING and now > since[0] + 3.0:
            rig.wish(wishes.Resume())
            since[0] = now + 1e9

    rig.run(turn)
    assert not left
    return rig


@pytest.mark.parametrize("relative", [True, False], ids=["relative E", "absolute E"])
@pytest.mark.parametrize("now", [False, True], ids=["behind the plan", "now"])
@pytest.mark.parametrize(("seed", "pauses"), [(0, 10), (1, 10), (2, 50)])
def test_the_part_is_the_same_after_all_pauses(seed: int, pauses: int, now: bool, relative: bool) -> None:
    text = scribble(seed, 200, relative=relative)
    whole = printed(text)
    chance = Random(seed)
    entries = sorted(chance.sample(range(12, 230), pauses))

    rig = paused_at(text, entries, wishes.Pause(now=now))

    assert isinstance(rig.events[-1], Finished)
    assert rig.events[-1].verified
    assert sum(isinstance(event, Paused) for event in rig.events) == pauses
    assert sum(isinstance(event, Resumed) for event in rig.events) == pauses
    if now:
        # M114 tells two decimals, so each stop may be off by half of the last one; of fifty, two fall into one move.
        assert off_path(rig.beads, whole.beads) < (0.0075 if pauses < 50 else 0.015)
        # Where the way comes back to the same hundredth, a loop of some hundredths is left out.
        assert off_path(whole.beads, rig.beads) < 0.1
        assert way(rig.beads) == pytest.approx(way(whole.beads), abs=0.03 * pauses)
    else:
        assert_same_beads(rig.beads, whole.beads)
    assert rig.printer._board.filament == pytest.approx(
        whole.printer._board.filament, abs=0.011 * pauses if now else 1e-3
    )


def test_a_parked_nozzle_is_off_the_part_and_above_it() -> None:
    rig = paused_at(tower(8), [150], wishes.Pause())
    parked = [end for _, end in rig.made if end[1] > 200]

    assert parked
    assert all(z >= 0.2 * 5 + 5 for _, _, z, _ in parked)


def test_now_is_sooner_than_behind_the_plan() -> None:
    text = "G28\nG90\nM83\nG1 Z1\n" + "".join(f"G1 X{10 + 80 * (i % 2)} Y{i} F1200\n" for i in range(100))

    def seconds(now: bool) -> float:
        rig = Rig(text)
        rig.connect()
        wished, waiting = [0.0], [0.0]

        def turn(at: float) -> None:
            if rig.streamer.acknowledged >= 30 and not wished[0]:
                wished[0] = at
                rig.wish(wishes.Pause(now=now, park=False))
            if rig.conductor.phase is Phase.WAITING:
                waiting[0] = waiting[0] or at
                board = rig.printer._board
                board.mover.advance(at)
                if not board.mover.busy:
                    rig.wish(wishes.Stop())

        rig.run(turn)
        return rig.port.now() - wished[0]

    assert seconds(now=True) < 12.0 < 40.0 < seconds(now=False)


def test_a_cold_pause_heats_up_again_before_it_goes_back() -> None:
    rig = paused_at(tower(6), [120], wishes.Pause(cold=True))
    lines = rig.of_job()
    cold = lines.index("M104 S0")
    hot = lines.index("M109 S200", cold)

    assert cold < hot
    assert not any(line.startswith("G1 X115") for line in lines[cold:hot])
    assert_same_beads(rig.beads, printed(tower(6)).beads)


def test_a_pause_here_moves_nothing() -> None:
    text = tower(5)
    rig = paused_at(text, [100], wishes.Pause(park=False))

    assert [line for line in rig.of_job() if line.startswith("G1 X")] == [
        line for line in printed(text).of_job() if line.startswith("G1 X")
    ]


def test_a_cold_machine_does_not_pull_filament() -> None:
    text = "G28\nG90\nM83\n" + "".join(f"G1 X{10 + i % 50} F3000\n" for i in range(300))
    rig = paused_at(text, [100], wishes.Pause())

    assert not any("E" in line for line in rig.of_job() if line.startswith("G1"))
    assert rig.printer.report().n_violations == 0
