"""Keys that control a print, read one by one from the terminal, which is restored afterwards."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event as Flag
from threading import Thread
from time import monotonic
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import UsageError

if sys.platform == "win32":
    import msvcrt
else:
    import termios
    import tty

if TYPE_CHECKING:
    from printer_slicer.printing import Controls

__all__ = ["HELP", "Keyboard", "keys"]

HELP: Final = (
    "keys: p pause, n pause now, r resume, c c cancel, + - speed, > < flow, u d nozzle up and down, s status,"
    " 0-9 answer, : G-code, ! ! emergency stop, ? help"
)
_TWICE: Final = 3.0
"""s within which a key for cancel or stop must be pressed a second time."""

_LOOK: Final = 0.1


class Keyboard:
    """Translates keys into commands for a print.

    Args:
        controls: of the print.
        tell: shows a line.
        clock: returns seconds.
    """

    def __init__(
        self, controls: Controls, tell: Callable[[str], None], clock: Callable[[], float] = monotonic
    ) -> None:
        self._controls = controls
        self._tell = tell
        self._clock = clock
        self._line: str | None = None
        self._first: tuple[str, float] = ("", 0.0)
        self._percent = {"speed": 100, "flow": 100}

    def press(self, key: str) -> None:
        """Handle a key."""
        if self._line is not None:
            self._type(key)
        elif key in {"c", "!"}:
            self._twice(key)
        elif key == ":":
            self._line = ""
            self._tell("G-code, then Enter:")
        elif key == "?":
            self._tell(HELP)
        elif (line := self._meaning(key)) is not None:
            self._send(line)

    def _meaning(self, key: str) -> str | None:
        """Return the command of a key; None if it has none."""
        if key.isdecimal() and key.isascii():
            return f"answer {key}"
        for name, more, less in (("speed", "+", "-"), ("flow", ">", "<")):
            if key in {more, less}:
                step = 5 if key == more else -5
                self._percent[name] = min(max(self._percent[name] + step, 10), 300)
                return f"{name} {self._percent[name]}"
        simple = {"p": "pause", "n": "pause now", "r": "resume", "s": "status"}
        return {**simple, "u": "babystep 0.02", "d": "babystep -0.02"}.get(key)

    def _twice(self, key: str) -> None:
        what = {"c": "cancel", "!": "stop"}[key]
        now = self._clock()
        if self._first[0] == key and now - self._first[1] <= _TWICE:
            self._first = ("", 0.0)
            self._send(what)
        else:
            self._first = (key, now)
            self._tell(f"press {key} again within 3 s to {what}")

    def _type(self, key: str) -> None:
        assert self._line is not None
        if key in {"\r", "\n"}:
            line, self._line = self._line.strip(), None
            if line:
                self._send(f"say {line}")
        elif key == "\x1b":
            self._line = None
        elif key in {"\x7f", "\b"}:
            self._line = self._line[:-1]
        elif key.isprintable():
            self._line += key

    def _send(self, line: str) -> None:
        from printer_slicer.printing.commands import Stop, parse_command

        try:
            command = parse_command(line)
            if isinstance(command, Stop):
                self._controls.stop()
            else:
                self._tell(self._controls.ask(command))
        except UsageError as error:
            self._tell(str(error).splitlines()[0])


@contextmanager
def keys(controls: Controls) -> Iterator[None]:
    """Let keys on the terminal control the print while the block runs."""

    def tell(text: str) -> None:
        """Print a line."""
        sys.stderr.write(text + "\n")

    tell(HELP)
    stop = Flag()
    with _single_keys():
        keyboard = Keyboard(controls, tell)
        thread = Thread(target=_listen, args=(keyboard, stop), name="keys", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(1.0)


if sys.platform == "win32":

    @contextmanager
    def _single_keys() -> Iterator[None]:
        yield

    def _listen(keyboard: Keyboard, stop: Flag) -> None:
        while not stop.wait(_LOOK):
            while msvcrt.kbhit():
                keyboard.press(msvcrt.getwch())

else:

    @contextmanager
    def _single_keys() -> Iterator[None]:
        """Deliver keys at once and without echo; Ctrl-C keeps its meaning."""
        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
        try:
            tty.setcbreak(terminal)
            yield
        finally:
            with suppress(termios.error):  # the terminal was closed meanwhile
                termios.tcsetattr(terminal, termios.TCSADRAIN, before)

    def _listen(keyboard: Keyboard, stop: Flag) -> None:
        terminal = sys.stdin.fileno()
        while not stop.is_set():
            if not select.select([terminal], [], [], _LOOK)[0]:
                continue
            try:
                pressed = os.read(terminal, 64)
            except OSError:
                return
            if not pressed:
                return
            for key in pressed.decode(errors="replace"):
                keyboard.press(key)
