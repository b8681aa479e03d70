"""Run a streamer over a transport until the print ends; it blocks only in `Transport.read`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from printer_slicer.stream.events import Event
    from printer_slicer.stream.protocol import Streamer

__all__ = ["Transport", "run"]


def run(  # noqa: PLR0913 - optional callbacks with default values
    streamer: Streamer,
    transport: Transport,
    clock: Callable[[], float],
    *,
    on_event: Callable[[Event], None] = lambda _: None,
    before_send: Callable[[float], None] = lambda _: None,
    record: Callable[[Sequence[Event]], None] = lambda _: None,
    longest_wait: float = 0.25,
) -> None:
    """Run a streamer until its print is done or halted; `streamer.state` says which.

    After any exception, such as Ctrl-C, it may be called again with the same streamer: truncated lines are detected and
    sent again. So a caller may cancel the print and call it again to run the end script.

    Args:
        streamer: the streamer to run.
        transport: connection to the printer.
        clock: monotonic time, s.
        on_event: called with each event; it may call methods of the streamer.
        before_send: called with the time before each call of `streamer.send`, to execute commands of other threads.
        record: called with the events before the corresponding bytes are written.
        longest_wait: maximum delay of a command from another thread, s.

    Raises:
        PortError: the connection is lost.
    """
    while True:
        before_send(clock())
        data = streamer.send(clock())
        events = streamer.events()
        record(events)
        if data:
            transport.write(data)
        for event in events:
            on_event(event)
        # A listener may end the print, which causes further events.
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
    """Byte stream to and from a printer: a serial port, a socket or a simulated cable."""

    def write(self, data: bytes) -> None:
        """Write all bytes.

        Raises:
            PortError: the connection is lost or accepts no data.
        """

    def read(self, timeout: float) -> bytes:
        """Return received bytes; empty if none arrive within `timeout` seconds.

        Raises:
            PortError: the connection is lost.
        """

    def close(self) -> None:
        """Close the connection; may be called again."""
