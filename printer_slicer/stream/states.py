"""All states of a streamer and all ways from one to another. There are no others."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["ENDED", "TRANSITIONS", "State", "Trigger"]


class State(Enum):
    """What the streamer is doing."""

    CONNECTING = "connecting"
    """Asks until the printer answers and starts its line numbers anew."""
    IDENTIFYING = "identifying"
    """Waits for the answer to line 1, who are you: after it, a printer that wants line 1 was reset."""
    STREAMING = "streaming"
    PAUSED = "paused"
    """Sends nothing of the job, only what is injected."""
    CANCELLING = "cancelling"
    """Sends the end script instead of the rest of the job."""
    FINISHING = "finishing"
    """Waits until the motion ends and asks where the printer is."""
    DONE = "done"
    HALTED = "halted"


class Trigger(Enum):
    """What may happen to it."""

    GREETED = "the printer answered"
    IDENTIFIED = "line 1 is answered"
    RESTARTED = "the printer has lost count"
    PAUSE = "pause"
    RESUME = "resume"
    CANCEL = "cancel"
    ACCEPTED = "the printer took everything"
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
"""What is not listed has no effect."""

ENDED: Final = frozenset(state for state, ways in TRANSITIONS.items() if not ways)
