"""What a person may want while it prints, and how a print ends."""

from __future__ import annotations

import pytest
from conversation import HOT, Conversation, again, first, moves, printing

from printer_slicer.errors import UsageError
from printer_slicer.stream.events import Action, Finished, Halted
from printer_slicer.stream.protocol import Streamer
from printer_slicer.stream.states import State

HEATERS_OFF = (b"M104 S0 ; nozzle", b"", b"M140 S0", b"M107")


def report(x: float, y: float, z: float) -> str:
    return f"X:{x:.2f} Y:{y:.2f} Z:{z:.2f} E:0.00 Count X:0 Y:0 Z:0"


# Pause and resume.


def test_a_paused_job_sends_no_more_lines_until_it_is_resumed(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.streamer.pause()

    assert talk.streamer.state is State.PAUSED
    assert talk.says("ok") == []
    assert talk.says("ok") == []
    assert talk.waits(3600.0) == []
    talk.streamer.resume()
    assert talk.waits(0.0) == [first(5, "G1 X3"), first(6, "G1 X4")]


def test_a_paused_job_still_repairs_the_wire(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.says("ok")
    talk.says("ok")
    talk.streamer.pause()

    talk.says("Error:checksum mismatch, Last Line: 4", "Resend: 5", "ok")

    assert talk.waits(0.3) == [again(5, "G1 X3")]


def test_the_printer_may_ask_for_a_pause(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)

    talk.says("//action:pause")
    assert talk.streamer.state is State.PAUSED
    talk.says("//action:notification Filament?")
    talk.says("//action:resume")
    assert talk.streamer.state is State.STREAMING
    said = [event.name for event in talk.happened(Action) if isinstance(event, Action)]
    assert said == ["pause", "notification Filament?", "resume"]


def test_wishes_that_make_no_sense_now_have_no_effect(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)

    talk.streamer.resume()
    assert talk.streamer.state is State.STREAMING
    talk.streamer.cancel()
    talk.streamer.pause()
    assert talk.streamer.state is State.CANCELLING
    talk.streamer.cancel(HEATERS_OFF)
    talk.says("ok")
    assert talk.says("ok") == [first(5, "M400")]


# Commands between the lines of the job.


def test_an_injected_command_goes_before_the_next_line_of_the_job(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.streamer.inject(b"M220 S80")
    talk.streamer.inject(b"; nothing at all")

    assert talk.says("ok") == [first(5, "M220 S80")]
    assert talk.says("ok") == [first(6, "G1 X3")]
    assert talk.says("ok") == [first(7, "G1 X4")]
    assert talk.streamer.acknowledged == 2


def test_an_injected_command_goes_out_while_the_job_is_paused(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.streamer.pause()
    talk.says("ok")
    talk.says("ok")

    talk.streamer.inject(b"G1 Z10")

    assert talk.waits(0.0) == [first(5, "G1 Z10")]


def test_a_long_injected_command_waits_until_there_is_room(bytewise: bool) -> None:
    long = "M117 " + "x" * 60
    talk, _ = printing([long, *moves(2)], bytewise=bytewise)

    talk.streamer.inject(long.encode())

    assert talk.says("ok") == [first(5, long)]


def test_a_command_that_can_never_be_sent_is_refused_at_once(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)

    with pytest.raises(UsageError):
        talk.streamer.inject(b"M117 " + b"x" * 96)
    with pytest.raises(UsageError):
        talk.streamer.cancel([b"M104 S0\nM140 S0"])
    assert talk.streamer.state is State.STREAMING


# Cancel and emergency stop.


def test_a_cancelled_job_runs_its_end_script_and_finishes(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.says("ok")

    talk.streamer.inject(b"M220 S80")
    talk.streamer.cancel(HEATERS_OFF)

    assert talk.says("ok") == [first(6, "M104 S0")]
    assert talk.says("ok") == [first(7, "M140 S0")]
    assert talk.says("ok") == [first(8, "M107")]
    talk.says("ok")
    assert talk.says("ok") == [first(9, "M400")]
    assert talk.says("ok") == [first(10, "M105")]
    assert talk.says(HOT) == [first(11, "M114")]
    assert talk.says(report(3, 0, 0), "ok") == []
    (finished,) = talk.happened(Finished)
    assert finished == Finished(3, True, (3.0, 0.0, 0.0), (3.0, None, None), True)


def test_a_long_line_of_the_end_script_waits_until_there_is_room(bytewise: bool) -> None:
    long = "M117 " + "x" * 60
    talk, _ = printing([*moves(1), long, long], bytewise=bytewise)

    talk.streamer.cancel([long.encode()])

    assert talk.says("ok") == []
    assert talk.says("ok") == [first(5, long)]


@pytest.mark.parametrize("wait", ["M109 S200", "M190 R60", "M0 Put the nut in"])
def test_cancelling_ends_a_wait_and_the_ok_of_that_acknowledges_nothing(wait: str, bytewise: bool) -> None:
    talk, _ = printing([wait, *moves(9)], bytewise=bytewise)

    talk.streamer.cancel(HEATERS_OFF)

    assert talk.waits(0.0) == [b"\nM108"]
    assert talk.says("ok") == [first(5, "M104 S0")]
    assert talk.says("ok") == [first(6, "M140 S0")]
    assert talk.says("ok") == []  # of M108
    assert talk.says("ok") == [first(7, "M107")]


def test_a_paused_job_can_be_cancelled(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.streamer.pause()
    talk.says("ok")

    talk.streamer.cancel(HEATERS_OFF)

    assert talk.waits(0.0) == [first(5, "M104 S0")]


def test_a_job_whose_last_moves_are_still_running_can_be_cancelled(bytewise: bool) -> None:
    talk, _ = printing(["G90"], bytewise=bytewise)
    assert talk.says("ok") == [first(4, "M400")]

    talk.streamer.cancel(HEATERS_OFF)

    assert talk.waits(0.0) == [first(5, "M104 S0")]
    talk.says("ok")
    assert talk.streamer.state is State.CANCELLING


def test_the_emergency_stop_goes_out_before_everything_and_nothing_goes_out_after_it(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    talk.streamer.emergency_stop()

    assert not talk.streamer.done
    assert talk.streamer.wakeup() == 0.0
    assert talk.waits(0.0) == [b"\nM112"]
    assert talk.streamer.done
    assert talk.says("ok", "ok", "ok") == []
    assert talk.waits(60.0) == []
    assert talk.happened(Halted) == [Halted("emergency stop", 0)]


@pytest.mark.parametrize("already", [State.CONNECTING, State.DONE, State.HALTED])
def test_the_emergency_stop_goes_out_in_every_state(already: State) -> None:
    talk = Conversation(Streamer([]))
    if already is not State.CONNECTING:
        talk, _ = printing([])
        talk.says("start") if already is State.HALTED else talk.says("ok")
    if already is State.DONE:
        talk.says(HOT)
        talk.says(report(0, 0, 0), "ok")
    assert talk.streamer.state is already

    talk.streamer.emergency_stop()

    assert talk.waits(0.0) == [b"\nM112"]
    assert talk.streamer.done


# The end.


def ending(job: list[str], *, bytewise: bool) -> Conversation:
    talk, out = printing(job, bytewise=bytewise)
    while out[-1] != first(len(job) + 3, "M400"):
        out = out + talk.says("ok")
    assert talk.says("ok") == [first(len(job) + 4, "M105")]
    assert talk.says(HOT) == [first(len(job) + 5, "M114")]
    return talk


def test_a_job_ends_when_the_printer_is_where_it_leads(bytewise: bool) -> None:
    talk = ending(["G90", "G1 X10.123 Y20 Z0.3"], bytewise=bytewise)

    assert talk.says(report(10.12, 20, 0.3), "ok") == []
    assert talk.streamer.state is State.DONE
    assert talk.streamer.done
    assert talk.happened(Finished) == [
        Finished(2, False, (10.12, 20.0, 0.3), (10.123, 20.0, 0.3), True),
    ]


def test_an_empty_job_ends_too(bytewise: bool) -> None:
    talk, out = printing([], bytewise=bytewise)

    assert out == [first(3, "M400")]
    assert talk.says("ok") == [first(4, "M105")]
    assert talk.says(HOT) == [first(5, "M114")]
    talk.says(report(0, 0, 0), "ok")
    assert talk.happened(Finished) == [Finished(0, False, (0.0, 0.0, 0.0), (None, None, None), None)]


def test_a_printer_that_is_elsewhere_is_asked_five_times_and_then_believed(bytewise: bool) -> None:
    talk = ending(["G90", "G1 X10"], bytewise=bytewise)

    for number in (8, 9, 10, 11):
        assert talk.says(report(18, 0, 0), "ok") == [first(number, "M114")]
    assert talk.says(report(18, 0, 0), "ok") == []
    (finished,) = talk.happened(Finished)
    assert isinstance(finished, Finished)
    assert finished.verified is False


def test_a_damaged_report_is_asked_for_again(bytewise: bool) -> None:
    talk = ending(["G90", "G1 X10"], bytewise=bytewise)

    assert talk.says("X:1q.00 Y:0.00 Z:0.00", "ok") == [first(8, "M114")]
    assert talk.says(report(10, 0, 0), "ok") == []
    (finished,) = talk.happened(Finished)
    assert isinstance(finished, Finished)
    assert finished.verified is True


def test_a_printer_that_never_says_where_it_is_ends_unverified(bytewise: bool) -> None:
    talk = ending(["G90", "G1 X10"], bytewise=bytewise)

    for _ in range(5):
        talk.says("ok")
    assert talk.happened(Finished) == [Finished(2, False, None, (10.0, None, None), None)]


def test_an_ok_too_many_does_not_end_it_early(bytewise: bool) -> None:
    talk, _ = printing(["G90"], bytewise=bytewise)
    assert talk.says("ok") == [first(4, "M400")]

    assert talk.says("ok") == [first(5, "M105")]  # it was not meant for M400
    assert talk.says("ok") == []  # this one was
    assert talk.says(HOT) == [first(6, "M114")]


def test_a_lost_last_line_is_found_out_before_the_end(bytewise: bool) -> None:
    talk, _ = printing(["G90", "G91"], bytewise=bytewise)
    talk.says("ok")
    assert talk.says("ok") == [first(5, "M400")]

    assert talk.says("Error:Line Number is not Last Line Number+1, Last Line: 3", "Resend: 4", "ok") == []
    assert talk.waits(0.3) == [again(4, "G91")]
    assert talk.streamer.acknowledged == 1
    assert talk.says("ok") == [again(5, "M400")]


def test_what_is_injected_at_the_end_moves_the_end(bytewise: bool) -> None:
    talk = ending(["G90", "G1 X10"], bytewise=bytewise)

    talk.streamer.inject(b"G1 X50")

    assert talk.says(report(10, 0, 0), "ok") == [first(8, "G1 X50")]
    assert talk.says("ok") == [first(9, "M400")]
    assert talk.says("ok") == [first(10, "M105")]
    assert talk.says(HOT) == [first(11, "M114")]
    talk.says(report(50, 0, 0), "ok")
    assert talk.streamer.state is State.DONE


# What others want to know, and say, in between.


def test_numbers_tell_how_far_the_job_is(bytewise: bool) -> None:
    talk, _ = printing(moves(5), bytewise=bytewise)
    streamer = talk.streamer
    assert (streamer.n_entries_taken, streamer.accepted_line_number, streamer.next_line_number) == (2, 2, 5)
    assert not streamer.is_idle

    streamer.pause()
    streamer.inject(b"M117 hello")
    assert streamer.injected_count == 1
    talk.says("ok")
    assert (streamer.injected_count, streamer.n_entries_taken) == (0, 2)
    assert (streamer.accepted_line_number, streamer.next_line_number) == (3, 6)
    talk.says("ok")
    assert not streamer.is_idle
    talk.says("ok")
    assert streamer.is_idle


def test_what_firmware_looks_at_early_goes_out_ahead_of_everything_and_counts_for_no_line(
    bytewise: bool,
) -> None:
    talk, out = printing(["M109 S200", *moves(3)], bytewise=bytewise)
    assert out == [first(3, "M109 S200"), first(4, "G1 X1")]

    talk.streamer.send_at_once(b"M108")
    assert talk.waits(0.0) == [b"\nM108"]
    talk.says("ok")
    assert talk.streamer.acknowledged == 1
    talk.says("ok")
    talk.says("ok")  # of M108: no line is accepted by it
    assert talk.streamer.acknowledged == 2


def test_what_cannot_be_sent_is_refused_and_before_the_greeting_nothing_is_urgent() -> None:
    talk, _ = printing(moves(2))
    with pytest.raises(UsageError):
        talk.streamer.send_at_once(b"M108\nM112")
    unmet = Streamer([b"G28"])
    unmet.send_at_once(b"M108")
    assert b"M108" not in unmet.send(0.0)


@pytest.mark.parametrize(
    "old",
    [
        ('echo:Unknown command: "M205"', "ok"),
        ('// Unknown command:"M205"', "ok"),
        ("echo:Fade Height 10.00", "ok"),
        ('echo:Unknown command: "M205"',),
        ("X:1.00 Y:2.00 Z:3.00 E:0.00 Count X:0 Y:0 Z:0",),
    ],
)
def test_what_answers_another_command_is_not_taken_for_the_cause(
    old: tuple[str, ...], bytewise: bool
) -> None:
    talk, _ = printing(["M205 X8", *moves(9)], bytewise=bytewise)
    talk.says(*old)

    talk.says("!! Endstop x still triggered after retract")

    (halted,) = talk.happened(Halted)
    assert halted.reason == "the printer stopped: !! Endstop x still triggered after retract"
