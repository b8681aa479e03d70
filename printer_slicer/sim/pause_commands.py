"""Commands that wait for a person.

A firmware with host prompts shows a question and a button (`//action:prompt_begin` and so on) and takes `M876 S0` as
the answer. Otherwise M108 or the button of the printer continues.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "ask_person"]


def ask_person(state: FirmwareState, command: Command) -> Steps:
    """M0, M1: wait for M108, for a given time, or for the simulated person."""
    yield from state.wait_for_moves()
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    yield from _asked(state, f"{command.code or 'M0'} Break Called", seconds)


def _change_filament(state: FirmwareState, _: Command) -> Steps:
    """M600: wait until a person has changed the filament."""
    yield from state.wait_for_moves()
    state.act("paused")
    yield from _asked(state, "Nozzle Parked", 0.0)
    state.load_filament()
    state.act("resumed")


def _asked(state: FirmwareState, question: str, seconds: float) -> Steps:
    """Ask and wait: `seconds` if not 0, else as long as the person takes."""
    _prompt(state, f"prompt_begin {question}", "prompt_button Continue", "prompt_show")
    until = state.now + (seconds if seconds > 0.0 else state.machine.person_seconds)
    state.waiting, state.busy_with = True, "paused for user"
    while state.waiting and state.now < until:
        yield until
    state.waiting, state.busy_with = False, "processing"
    _prompt(state)


def _prompt(state: FirmwareState, *lines: str) -> None:
    """Send a host prompt, or close it without lines."""
    if state.firmware.prompts:
        for line in ("prompt_end", *lines):
            state.say(f"//action:{line}")


def _answer(state: FirmwareState, command: Command) -> None:
    """M876: answer of the person at the host."""
    if not state.firmware.prompts:
        state.unknown(command.text)
    elif command.value("S") is not None:
        state.waiting = False


TABLE: Final = {
    "M0": ask_person,
    "M1": ask_person,
    "M600": _change_filament,
    "M601": ask_person,
    "M876": _answer,
}
