"""Control a print with keys on the terminal, which is restored afterwards."""

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

__all__ = ["HELP", "Keyboard", "control_by_keys"]

HELP: Final = (
    "keys: p pause, n pause now, r resume, c (twice) cancel, + and - speed, > and < flow, u and d nozzle up and down, "
    "s status, 0-9 answer the printer, : type G-code, ! (twice) emergency stop, ? help"
)
_CONFIRM_SECONDS: Final = 3.0
"""Time, s, within which the key for cancel or emergency stop must be pressed a second time."""

_POLL_SECONDS: Final = 0.1


class Keyboard:
    """Translates keys into commands for a print.

    Args:
        controls: the controls of the print.
        tell: function that shows a line of text.
        clock: function that returns the time, s.
    """

    def __init__(
        self, controls: Controls, tell: Callable[[str], None], clock: Callable[[], float] = monotonic
    ) -> None:
        self._controls = controls
        self._tell = tell
        self._clock = clock
        self._line: str | None = None
        self._unconfirmed: tuple[str, float] = ("", 0.0)
        self._percent = {"speed": 100, "flow": 100}

    def press(self, key: str) -> None:
        """Handle a key."""
        if self._line is not None:
            self._edit_line(key)
        elif key in {"c", "!"}:
            self._confirm_command(key)
        elif key == ":":
            self._line = ""
            self._tell("G-code, then Enter:")
        elif key == "?":
            self._tell(HELP)
        elif (line := self._find_command_of_key(key)) is not None:
            self._send_command(line)

    def _find_command_of_key(self, key: str) -> str | None:
        """Return the command of a key; None if the key has no command."""
        if key.isdecimal() and key.isascii():
            return f"answer {key}"
        for name, more, less in (("speed", "+", "-"), ("flow", ">", "<")):
            if key in {more, less}:
                step = 5 if key == more else -5
                self._percent[name] = min(max(self._percent[name] + step, 10), 300)
                return f"{name} {self._percent[name]}"
        simple = {"p": "pause", "n": "pause now", "r": "resume", "s": "status"}
        return {**simple, "u": "babystep 0.02", "d": "babystep -0.02"}.get(key)

    def _confirm_command(self, key: str) -> None:
        """Send the command of a key if it was pressed twice; ask for the second press otherwise."""
        what = {"c": "cancel", "!": "abort"}[key]
        now = self._clock()
        if self._unconfirmed[0] == key and now - self._unconfirmed[1] <= _CONFIRM_SECONDS:
            self._unconfirmed = ("", 0.0)
            self._send_command(what)
        else:
            self._unconfirmed = (key, now)
            self._tell(f"press {key} again within 3 s to {what}")

    def _edit_line(self, key: str) -> None:
        """Apply a key to the line of G-code that is being typed; Enter sends it, Escape discards it."""
        assert self._line is not None
        if key in {"\r", "\n"}:
            line, self._line = self._line.strip(), None
            if line:
                self._send_command(f"say {line}")
        elif key == "\x1b":
            self._line = None
        elif key in {"\x7f", "\b"}:
            self._line = self._line[:-1]
        elif key.isprintable():
            self._line += key

    def _send_command(self, line: str) -> None:
        """Send a command to the print, and show the answer or the error."""
        from printer_slicer.printing.commands import Abort, parse_command

        try:
            command = parse_command(line)
            if isinstance(command, Abort):
                self._controls.abort()
            else:
                self._tell(self._controls.ask(command))
        except UsageError as error:
            self._tell(str(error).splitlines()[0])


@contextmanager
def control_by_keys(controls: Controls) -> Iterator[None]:
    """Control the print with keys on the terminal while the `with` block runs."""

    def tell(text: str) -> None:
        """Print a line."""
        sys.stderr.write(text + "\n")

    tell(HELP)
    stop = Flag()
    with _disable_line_buffering():
        keyboard = Keyboard(controls, tell)
        thread = Thread(target=_handle_keys, args=(keyboard, stop), name="keys", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join(1.0)


if sys.platform == "win32":

    @contextmanager
    def _disable_line_buffering() -> Iterator[None]:
        yield

    def _handle_keys(keyboard: Keyboard, stop: Flag) -> None:
        while not stop.wait(_POLL_SECONDS):
            while msvcrt.kbhit():
                keyboard.press(msvcrt.getwch())

else:

    @contextmanager
    def _disable_line_buffering() -> Iterator[None]:
        """Switch the terminal to single keys without echo, and restore it at the end; Ctrl-C keeps its meaning."""
        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
        try:
            tty.setcbreak(terminal)
            yield
        finally:
            with suppress(termios.error):  # the terminal was closed meanwhile
                termios.tcsetattr(terminal, termios.TCSADRAIN, before)

    def _handle_keys(keyboard: Keyboard, stop: Flag) -> None:
        terminal = sys.stdin.fileno()
        while not stop.is_set():
            if not select.select([terminal], [], [], _POLL_SECONDS)[0]:
                continue
            try:
                pressed = os.read(terminal, 64)
            except OSError:
                return
            if not pressed:
                return
            for key in pressed.decode(errors="replace"):
                keyboard.press(key)
