"""Run a streamer over a transport until the print ends; it blocks only in `Transport.read`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.stream.events import Event
    from printer_slicer.stream.protocol import Streamer

__all__ = ["Transport", "run"]


def run(  # noqa: PLR0913 - all but three have a good default
    streamer: Streamer,
    transport: Transport,
    clock: Callable[[], float],
    *,
    on_event: Callable[[Event], None] = lambda _: None,
    on_turn: Callable[[float], None] = lambda _: None,
    record: Callable[[Sequence[Event]], None] = lambda _: None,
    longest_wait: float = 0.25,
) -> None:
    """Stream until the printer is done, or halted; `streamer.state` tells which.

    It may be left by any exception, such as Ctrl-C, and called again with the same streamer: what was cut off
    on its way is found missing and sent again. So a caller may cancel in between and run the end script.

    Args:
        streamer: what to say.
        transport: whom to say it to.
        clock: seconds, from any beginning, never backwards.
        on_event: called with each event; it may call the methods of the streamer.
        on_turn: called with the time before each sending: the place to grant what other threads wish.
        record: called with the events, before the bytes that go with them are written.
        longest_wait: s after which a wish of another thread, to pause or to stop, is noticed.

    Raises:
        PortError: the cable is gone.
    """
    while True:
        on_turn(clock())
        data = streamer.send(clock())
        events = streamer.events()
        record(events)
        if data:
            transport.write(data)
        for event in events:
            on_event(event)
        # A listener may end the print, and that is told too.
        while events := streamer.events():
            record(events)
            for event in events:
                on_event(event)
        if streamer.done:
            return
        due = streamer.wakeup()
        wait = longest_wait if due is None else min(max(due - clock(), 0.0), longest_wait)
        streamer.receive(transport.read(wait), clock())


class Transport(Protocol):
    """Bytes to and from a printer: a serial port, a socket, a simulated cable."""

    def write(self, data: bytes) -> None:
        """Hand over all bytes.

        Raises:
            PortError: the other end is gone or takes nothing.
        """

    def read(self, timeout: float) -> bytes:
        """What has come, as soon as there is something, empty after `timeout` seconds without.

        Raises:
            PortError: the other end is gone.
        """

    def close(self) -> None:
        """Let go of it; once is enough, twice does no harm."""
