"""States of a streamer and all transitions between them."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["ENDED", "TRANSITIONS", "State", "Trigger"]


class State(Enum):
    """State of a streamer, from connecting to the printer until the print is done or halted."""

    CONNECTING = "connecting"
    """Resets line numbers until the printer answers."""
    IDENTIFYING = "identifying"
    """Waits for the answer to line 1. If the printer requests line 1 again later, it was reset."""
    STREAMING = "streaming"
    PAUSED = "paused"
    """Sends only injected commands, nothing of the job."""
    CANCELLING = "cancelling"
    """Sends the end script instead of the rest of the job."""
    FINISHING = "finishing"
    """Waits for the end of the motion and queries the position."""
    DONE = "done"
    HALTED = "halted"


class Trigger(Enum):
    """Cause of a change of the state of a streamer."""

    GREETED = "the printer answered"
    IDENTIFIED = "line 1 is answered"
    RESTARTED = "the printer was reset"
    PAUSE = "pause"
    RESUME = "resume"
    CANCEL = "cancel"
    ACCEPTED = "the printer accepted everything"
    FINISH = "the motion ended"
    HALT = "halt"


TRANSITIONS: Final[Mapping[State, Mapping[Trigger, State]]] = {
    State.CONNECTING: {
        Trigger.GREETED: State.IDENTIFYING,
        Trigger.RESTARTED: State.CONNECTING,
        Trigger.CANCEL: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.IDENTIFYING: {
        Trigger.IDENTIFIED: State.STREAMING,
        Trigger.RESTARTED: State.CONNECTING,
        Trigger.CANCEL: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.STREAMING: {
        Trigger.PAUSE: State.PAUSED,
        Trigger.CANCEL: State.CANCELLING,
        Trigger.ACCEPTED: State.FINISHING,
        Trigger.RESTARTED: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.PAUSED: {
        Trigger.RESUME: State.STREAMING,
        Trigger.CANCEL: State.CANCELLING,
        Trigger.RESTARTED: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.CANCELLING: {
        Trigger.ACCEPTED: State.FINISHING,
        Trigger.RESTARTED: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.FINISHING: {
        Trigger.CANCEL: State.CANCELLING,
        Trigger.FINISH: State.DONE,
        Trigger.RESTARTED: State.HALTED,
        Trigger.HALT: State.HALTED,
    },
    State.DONE: {},
    State.HALTED: {},
}
"""Next state for each state and trigger. A trigger that is not listed has no effect."""

ENDED: Final = frozenset(state for state, transitions in TRANSITIONS.items() if not transitions)
