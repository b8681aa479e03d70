"""A printer that restarts in the middle of a part: the second half begins where the first one ended."""

from __future__ import annotations

from pathlib import Path
from random import Random  # noqa: TID251 - seeded

import pytest
from printed import scribble, tower
from rig import SETUP, Piece, Rig, laid, way

from printer_slicer.jobs import build_job
from printer_slicer.printing.job_store import PortAddress, create_print
from printer_slicer.printing.recovery import plan_recovery
from printer_slicer.stream.events import Finished, Halted


def halves(text: str, folder: Path, entries: int, delay: float) -> tuple[list[Piece], Rig]:
    """What lay on the bed when a printer restarted, some s after it had taken so many commands, and what came then."""
    job = build_job("part.gcode", text.encode(), limits=SETUP.limits, corner=SETUP.low, flavour=SETUP.flavour)
    print_ = create_print(folder, job.name, job.text, PortAddress("/dev/none", 250_000), SETUP)
    before = Rig(text, folder=print_.folder)
    before.connect()
    first: list[float] = []
    made: list[Piece] = []

    def watch(now: float) -> None:
        if before.streamer.acknowledged >= entries and not first:
            first.append(now)
        if first and not made and now >= first[0] + delay:
            before.made  # noqa: B018 - up to this moment
            before.printer.state.stop_moving()
            made.extend(before.made)
            before.printer.reset(now)

    before.run(watch)
    (halted,) = [event for event in before.events if isinstance(event, Halted)]
    assert "reset" in halted.reason
    assert before.journal
    before.journal.record_end(halted.reason, before.port.now())
    before.journal.close()
    print_.release()
    after = Rig(text, folder=print_.folder)
    after.connect(plan_recovery(print_, job))
    after.run()
    return laid(made), after


@pytest.mark.parametrize("seed", range(12))
def test_the_second_half_begins_where_a_reset_ended_the_first(seed: int, tmp_path: Path) -> None:
    chance = Random(seed)
    text = tower(6) if seed % 2 else scribble(seed, 150, relative=bool(seed % 4))
    whole = Rig(text)
    whole.connect()
    whole.run()

    beads, after = halves(text, tmp_path, chance.randrange(40, 140), chance.uniform(0.0, 0.5))

    assert isinstance(after.events[-1], Finished)
    assert abs(way(beads) + way(after.beads) - way(whole.beads)) <= 0.2
    x, y, *_ = beads[-1][1]
    bx, by, *_ = after.beads[0][0]
    assert ((x - bx) ** 2 + (y - by) ** 2) ** 0.5 <= 0.2
