"""Commands that wait for a person.

A firmware with host prompts sends a question and a button to the host (`//action:prompt_begin` and so on). `M876 S0` is
the answer. Otherwise M108 or the button of the printer ends the wait.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.firmware_state import FirmwareState, Steps
    from printer_slicer.sim.parsed_command import Command

__all__ = ["TABLE", "wait_for_person"]


def wait_for_person(state: FirmwareState, command: Command) -> Steps:
    """M0, M1: wait for M108, the given time, or the simulated person at the button."""
    yield from state.wait_for_moves()
    seconds = command.value("S") or (command.value("P") or 0.0) / 1000.0
    yield from _ask_and_wait(state, f"{command.code or 'M0'} Break Called", seconds)


def _change_filament(state: FirmwareState, _: Command) -> Steps:
    """M600: wait until a person has changed the filament."""
    yield from state.wait_for_moves()
    state.send_action("paused")
    yield from _ask_and_wait(state, "Nozzle Parked", 0.0)
    state.load_filament()
    state.send_action("resumed")


def _ask_and_wait(state: FirmwareState, question: str, seconds: float) -> Steps:
    """Ask a question and wait up to `seconds` for the answer; 0: until the simulated person answers."""
    _send_prompt(state, f"prompt_begin {question}", "prompt_button Continue", "prompt_show")
    until = state.now + (seconds if seconds > 0.0 else state.machine.person_seconds)
    state.waiting, state.busy_with = True, "paused for user"
    while state.waiting and state.now < until:
        yield until
    state.waiting, state.busy_with = False, "processing"
    _send_prompt(state)


def _send_prompt(state: FirmwareState, *lines: str) -> None:
    """Send these lines as a host prompt; without lines, close the prompt."""
    if state.firmware.prompts:
        for line in ("prompt_end", *lines):
            state.send_line(f"//action:{line}")


def _end_wait_on_answer(state: FirmwareState, command: Command) -> None:
    """M876: end the wait, because the person at the host has answered."""
    if not state.firmware.prompts:
        state.reply_unknown_command(command.text)
    elif command.value("S") is not None:
        state.waiting = False


TABLE: Final = {
    "M0": wait_for_person,
    "M1": wait_for_person,
    "M600": _change_filament,
    "M601": wait_for_person,
    "M876": _end_wait_on_answer,
}
