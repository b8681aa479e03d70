"""The temperatures of the last 24 hours."""

from __future__ import annotations

from itertools import pairwise

from printer_slicer.server.temperatures import TemperatureHistory


def test_samples_are_fine_for_half_an_hour_and_one_a_minute_for_a_day() -> None:
    history = TemperatureHistory()
    history.add("left", {}, 0.0)
    end = 30 * 3600
    for second in range(end):
        history.add("left", {"T": [200.0 + second % 5, 210.0]}, float(second))
    times = [one.time for one in history.list_samples("left")]
    assert times == sorted(times)
    steps = {after - before for before, after in pairwise(times)}
    assert max(steps) <= 60
    assert len(times) <= 900 + 1440
    assert end - 1 - times[0] <= 86400
    assert end - 1 - times[0] >= 86400 - 60
    assert sum(time > end - 1800 for time in times) >= 899
    assert history.list_samples("right") == ()
