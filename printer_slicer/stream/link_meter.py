"""Measure a serial link: throughput, latency, resends, buffer underruns and quality of the cable.

The meter receives the bytes of both directions with their times. It makes no decisions, and its memory does not grow
with the length of the print. A full planner delays answers, which says nothing about the link. So the meter models the
planner and leaves such answers out of the latency. The same model counts buffer underruns.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from math import exp2, floor, inf, log2
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import TABLE, Effect, find_codes
from printer_slicer.gcode.lexer import parse, split_line_number, strip
from printer_slicer.gcode.state import MachineState
from printer_slicer.motion.planner_clock import PlannerClock
from printer_slicer.motion.rules import make_block
from printer_slicer.stream.events import PoorLink, Probe, ResendRequested
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.motion.rules import MotionLimits
    from printer_slicer.stream.events import Event
    from printer_slicer.stream.session import Transport

__all__ = ["LinkMeter", "LinkQuality", "LinkStatistics", "MeteredTransport", "check_link_quality"]

_OK: Final = re.compile(rb"ok\b(?: N(\d+))?")
_RESEND: Final = re.compile(rb"(?:Resend:|rs )\s*N?:?\s*(\d+)")

_STEPS_PER_DOUBLING: Final = 16
"""Number of histogram steps per doubling of the latency; a step is 4 %."""

_WAITS: Final = find_codes(Effect.WAITS)
_IMMEDIATE: Final = (
    find_codes(Effect.MOVES | Effect.MODE | Effect.SETS_POSITION | Effect.FAN)
    | {code for code, row in TABLE.items() if row.heater}
) - _WAITS
"""Commands that are acknowledged at once if the command queue is not full."""

_MAX_PARTIAL_LINE: Final = 1024


class LinkStatistics(Struct, frozen=True):
    """Statistics of a serial link. Times in s.

    Attributes:
        lines: number of acknowledged lines, each counted once.
        seconds: time from the first line to the last answer, without heating, homing and waiting for users.
        lines_per_second: average throughput.
        most_lines_per_second: largest number of lines acknowledged within one second.
        bytes_sent: number of bytes sent to the printer.
        latency, latency_95: median and 95th percentile of the response time; None if the planner or a slow command
            delayed every answer.
        resends: number of resend requests.
        resent_lines: number of lines sent again.
        lost_answers: number of acknowledgements that were missing or unreadable.
        underruns, underrun_seconds: number and total time of buffer underruns, by the model of the planner.
        warning: warning about the cable; None if it is good.
    """

    lines: int
    seconds: float
    lines_per_second: float
    most_lines_per_second: int
    bytes_sent: int
    latency: float | None
    latency_95: float | None
    resends: int
    resent_lines: int
    lost_answers: int
    underruns: int
    underrun_seconds: float
    warning: PoorLink | None = None

    def __str__(self) -> str:
        times = (
            f"latency {self.latency * 1000:.3g} ms, 95 % within {self.latency_95 * 1000:.3g} ms"
            if self.latency is not None and self.latency_95 is not None
            else "latency unknown"
        )
        waits = (
            f"{self.underruns} buffer underruns ({self.underrun_seconds:.3g} s)"
            if self.underruns
            else "no buffer underruns"
        )
        return (
            f"{self.lines_per_second:.0f} lines/s, peak {self.most_lines_per_second}; {times}; "
            f"{self.resends} resends, {self.lost_answers} lost answers; {waits}"
        )


class LinkMeter:
    """Collects statistics from the bytes in both directions of a serial link.

    Args:
        limits: motion limits of the machine; None: buffer underruns are not counted.
    """

    def __init__(self, limits: MotionLimits | None = None) -> None:
        self._limits = limits
        self._clock = PlannerClock(limits) if limits is not None else None
        self._machine = MachineState()
        self._lines_in_flight: deque[tuple[int, bytes, float]] = deque()
        self._partial = b""
        self._ignore_next_ok = False
        self._highest_line = 0
        self._latencies: Counter[int] = Counter()
        self._current_second: tuple[int, int] = (0, 0)
        self._peak_rate = 0
        self._n_lines = self._n_bytes = self._n_resends = self._n_resent_lines = 0
        self._quality = LinkQuality()
        self._first_sent_at = self._last_ack_at = inf
        self._waiting_seconds = 0.0  # s that waiting commands took
        self._last_line_waits = (
            False  # whether the last line was a waiting command, which delayed the next line
        )

    def on_sent(self, data: bytes, now: float) -> None:
        """Record bytes that were sent to the printer at `now`, s."""
        self._n_bytes += len(data)
        for line in data.split(b"\n"):
            number, command = split_line_number(line)
            if number is None:
                continue
            if not strip(command):  # M110
                self._lines_in_flight.clear()
                self._highest_line = 0
                continue
            if number <= self._highest_line:
                self._n_resent_lines += 1
            self._highest_line = max(self._highest_line, number)
            self._first_sent_at = min(self._first_sent_at, now)
            self._lines_in_flight.append((number, command, now))

    def on_event(self, event: Event) -> None:
        """Count resends and probes, which the streamer reports as events."""
        self._quality.on_event(event)

    def find_new_warnings(self) -> tuple[PoorLink, ...]:
        """Return a warning if the number of link errors has doubled since the last warning, else nothing."""
        found = self._quality.find_new_warning(self._n_lines)
        return () if found is None else (found,)

    def on_received(self, data: bytes, now: float) -> None:
        """Record bytes that were received from the printer at `now`, s."""
        if not data:
            return
        *lines, self._partial = (self._partial + data).split(b"\n")
        self._partial = self._partial[-_MAX_PARTIAL_LINE:]
        for line in lines:
            if found := _OK.match(line):
                self._on_ok(int(found[1]) if found[1] else None, now)
            elif found := _RESEND.match(line):
                self._on_resend_request(int(found[1]))

    def statistics(self) -> LinkStatistics:
        """Return the statistics of the link so far."""
        seconds = (
            max(self._last_ack_at - self._first_sent_at - self._waiting_seconds, 0.0)
            if self._n_lines
            else 0.0
        )
        return LinkStatistics(
            lines=self._n_lines,
            seconds=seconds,
            lines_per_second=self._n_lines / seconds if seconds > 0 else 0.0,
            most_lines_per_second=self._peak_rate,
            bytes_sent=self._n_bytes,
            latency=self._find_latency_quantile(0.5),
            latency_95=self._find_latency_quantile(0.95),
            resends=self._n_resends,
            resent_lines=self._n_resent_lines,
            lost_answers=self._quality.lost_answers,
            underruns=self._clock.stalls if self._clock else 0,
            underrun_seconds=self._clock.stalled_seconds if self._clock else 0.0,
            warning=check_link_quality(self._n_lines, self._quality.resends, self._quality.lost_answers),
        )

    def _on_resend_request(self, number: int) -> None:
        """Handle a resend request: lines from `number` on will be sent again."""
        self._n_resends += 1
        self._ignore_next_ok = True
        while self._lines_in_flight and self._lines_in_flight[-1][0] >= number:
            self._lines_in_flight.pop()

    def _on_ok(self, number: int | None, now: float) -> None:
        """Handle an ok: it acknowledges all lines up to `number`, or one line if None."""
        if self._ignore_next_ok:
            self._ignore_next_ok = False
            if number is None:
                return
        last = number if number is not None else (self._lines_in_flight[0][0] if self._lines_in_flight else 0)
        while self._lines_in_flight and self._lines_in_flight[0][0] <= last:
            _, command, sent = self._lines_in_flight.popleft()
            self._record_acknowledgement(command, sent, now)

    def _record_acknowledgement(self, command: bytes, sent: float, now: float) -> None:
        """Record the acknowledgement of a command that was sent at `sent`, s."""
        since = max(sent, self._last_ack_at) if self._n_lines else sent
        word, values = parse(command)
        move = self._machine.apply(word, values, command)
        is_delayed = self._last_line_waits or (self._clock is not None and self._clock.is_full(since))
        self._last_line_waits = word in _WAITS
        if self._last_line_waits:
            self._waiting_seconds += now - since
            if self._clock:
                self._clock.finish_moves(now)
        elif word in _IMMEDIATE and not is_delayed:
            self._latencies[floor(log2(max(now - sent, 1e-6)) * _STEPS_PER_DOUBLING)] += 1
        if move is not None and self._clock is not None and self._limits is not None:
            block = make_block(self._limits, move.delta, move.speed)
            if block is not None:
                self._clock.push(block, now)
        self._n_lines += 1
        self._last_ack_at = now
        second, count = self._current_second
        self._current_second = (floor(now), count + 1 if floor(now) == second else 1)
        self._peak_rate = max(self._peak_rate, self._current_second[1])

    def _find_latency_quantile(self, quantile: float) -> float | None:
        """Return the latency, s, at a quantile from 0 to 1; None if no latency was measured."""
        remaining = quantile * self._latencies.total()
        for step in sorted(self._latencies):
            remaining -= self._latencies[step]
            if remaining <= 0:
                return exp2((step + 0.5) / _STEPS_PER_DOUBLING)
        return None


class MeteredTransport:
    """Transport that passes all bytes on to another transport, and to a meter."""

    def __init__(self, transport: Transport, meter: LinkMeter, clock: Callable[[], float]) -> None:
        self._transport = transport
        self._meter = meter
        self._clock = clock

    def write(self, data: bytes) -> None:
        """Write all bytes."""
        self._meter.on_sent(data, self._clock())
        self._transport.write(data)

    def read(self, timeout: float) -> bytes:
        """Return received bytes; wait at most `timeout` s for the first."""
        data = self._transport.read(timeout)
        self._meter.on_received(data, self._clock())
        return data

    def close(self) -> None:
        """Close the wrapped transport."""
        self._transport.close()


_UNDETECTED_SHARE: Final = 1 / 256
"""Fraction of the lines with several damaged bytes that the checksum does not detect."""

_SAME_BIT_SHARE: Final = 1 / 16
"""Fraction of the lines with two flipped bits where both flips have the same bit position."""

_LIKELY_UNDETECTED: Final = 0.25
"""Expected number of undetected damaged lines from which the warning calls undetected damage likely."""

_HARMLESS_COUNT: Final = 5
"""Number of resends or lost acknowledgements that is normal on any cable."""

_HARMLESS_PER_1000: Final = 2.0
"""Rate of resends or lost acknowledgements per 1000 lines that a good cable stays below."""

_WARNING_COUNT: Final = 50
"""Number of resends or lost acknowledgements that causes a warning in a print of any length."""

_CABLE_REMEDY: Final = (
    "Use a short cable with ferrites, away from motors and heaters, and a USB port of its own"
)


class LinkQuality:
    """Counts link errors, and warns each time that their number doubles.

    An 8-bit checksum misses one in 256 of the lines that are damaged in several places. It also misses two flips of the
    same bit position: with r resends per line, about r^2/16 of the lines. The larger of the two is the expected number
    of undetected damaged lines.

    Attributes:
        resends: number of resend requests.
        lost_answers: number of acknowledgements that got lost.
    """

    def __init__(self) -> None:
        self.resends = self.lost_answers = 0
        self._count_at_warning = 0

    def on_event(self, event: Event) -> None:
        """Count the event if it reports a resend request or a probe."""
        self.resends += isinstance(event, ResendRequested)
        self.lost_answers += isinstance(event, Probe)

    def find_new_warning(self, lines: int) -> PoorLink | None:
        """Return a warning if the errors have doubled since the last warning; `lines`: acknowledged lines."""
        count = self.resends + self.lost_answers
        if count < 2 * self._count_at_warning:
            return None
        found = check_link_quality(lines, self.resends, self.lost_answers)
        if found is not None:
            self._count_at_warning = count
        return found


def check_link_quality(lines: int, resends: int, lost_answers: int) -> PoorLink | None:
    """Return a warning about a bad cable; None if the cable is good.

    Args:
        lines: number of acknowledged lines.
        resends: number of resend requests.
        lost_answers: number of acknowledgements that got lost.
    """
    worst = max(resends, lost_answers)
    per_1000 = 1000 * resends / max(lines, 1)
    if worst < _WARNING_COUNT and (worst <= _HARMLESS_COUNT or 1000 * worst <= _HARMLESS_PER_1000 * lines):
        return None
    undetected = max(resends * _UNDETECTED_SHARE, lines * (resends / max(lines, 1)) ** 2 * _SAME_BIT_SHARE)
    parts = [f"{resends} resends ({per_1000:.3g} per 1000 lines)"] if resends else []
    if lost_answers:
        parts.append(
            f"{lost_answers} lost acknowledgements, each of which may have stopped the nozzle on the part"
        )
    if undetected >= _LIKELY_UNDETECTED:
        parts.append("undetected damage is likely")
    text = f"bad cable: {'; '.join(parts)}. {_CABLE_REMEDY}"
    return PoorLink(lines, resends, lost_answers, round(per_1000, 3), round(undetected, 3), text)
