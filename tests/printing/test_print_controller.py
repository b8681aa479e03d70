"""Commands of users, prompts of the printer, temperatures, cancelled objects."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import pytest
from printed import tower
from rig import SETUP, Rig, laid

from printer_slicer.errors import UsageError
from printer_slicer.printing import commands
from printer_slicer.printing.controls import Controls
from printer_slicer.printing.objects import LiveJob, find_object_spans
from printer_slicer.printing.print_controller import PrintPhase
from printer_slicer.sim.firmwares import MARLIN_2_0_AVR, MARLIN_2_1
from printer_slicer.stream.events import (
    Action,
    Event,
    Finished,
    Halted,
    Message,
    Paused,
    Prompt,
    Resumed,
    StreamWarning,
    Temperature,
)
from tests.effort import crossed

LINES = "G28\nG90\nM83\nG1 Z1 F600\n" + "".join(
    f"G1 X{10 + i % 60} Y{10 + i % 7} F6000\n" for i in range(400)
)


def run_with(rig: Rig, at: dict[int, commands.PrintCommand]) -> Rig:
    """Print, and submit a command after a number of accepted commands."""
    rig.connect()
    left = dict(at)

    def turn(_: float) -> None:
        for entries in [n for n in left if rig.streamer.acknowledged >= n]:
            rig.submit(left.pop(entries))

    rig.run(turn)
    assert not left
    return rig


@pytest.mark.parametrize(
    ("command", "gcode"),
    [
        (commands.Speed(80), "M220 S80"),
        (commands.Flow(95), "M221 S95"),
        (commands.SetTemperature("nozzle", 205), "M104 S205"),
        (commands.SetTemperature("bed", 55), "M140 S55"),
        (commands.SetFan(50), "M106 S128"),
        (commands.Say("M117 hello"), "M117 hello"),
    ],
)
def test_a_request_becomes_a_command_in_the_middle_of_the_job(
    command: commands.PrintCommand, gcode: str
) -> None:
    rig = run_with(Rig(LINES), {100: command})
    where = rig.of_job().index(gcode)

    assert 100 <= where <= 110
    assert [line for line in rig.of_job() if line != gcode] == LINES.split("\n")[:-1]


def test_baby_steps_are_refused_by_a_firmware_that_says_it_has_none_and_are_words_of_klipper() -> None:
    refused = run_with(Rig(LINES, replace(MARLIN_2_1, babysteps=False)), {50: commands.BabyStep(0.02)})
    klipper = run_with(Rig(LINES, setup=replace(SETUP, flavour="klipper")), {50: commands.BabyStep(-0.02)})

    assert isinstance(refused.answers[0], UsageError)
    assert "SET_GCODE_OFFSET Z_ADJUST=-0.020 MOVE=1" in klipper.of_job()


def test_cancelling_a_file_in_inches_lifts_five_millimetres() -> None:
    text = tower(6).replace("G90\n", "G90\nG20\n", 1)
    rig = run_with(Rig(text), {20: commands.Cancel()})
    script = rig.of_job()[rig.of_job().index("M107") :]

    assert script.index("G21") < script.index("G1 Z5 F300")


def test_cancelling_runs_the_end_script_off_the_part() -> None:
    rig = run_with(Rig(tower(6)), {90: commands.Cancel()})
    end = rig.events[-1]

    assert isinstance(end, Finished)
    assert end.cancelled
    assert rig.of_job()[-8:] == [
        "M104 S0",
        "M140 S0",
        "M107",
        "G91",
        "G1 Z5 F300",
        "G90",
        "G1 X5 Y215 F6000",
        "M84",
    ]


def test_a_policy_may_refuse_what_a_person_types() -> None:
    rig = Rig(LINES)
    rig.connect()
    rig.controller._allow = lambda command: "not here" if command.startswith(b"M500") else ""
    rig.submit(commands.Say("M500"))

    def later(_: float) -> None:
        if rig.streamer.acknowledged == 20:
            rig.submit(commands.Say("M500"))

    rig.run(later)

    assert any("not here" in str(answer) for answer in rig.answers)
    assert "M500" not in rig.executed


@pytest.mark.parametrize(
    "gcode", ["G28", "g28 X Y", "N5 G1 X0 ; home", "G91", "M83", "G92 E0", "G20", "G10", "T1", "M84"]
)
def test_a_typed_command_that_changes_the_position_is_rejected_while_the_print_runs(gcode: str) -> None:
    rig = run_with(Rig(LINES), {100: commands.Say(gcode)})

    assert isinstance(rig.answers[0], UsageError)
    assert "Pause the print" in rig.answers[0].remedy
    assert rig.of_job() == LINES.split("\n")[:-1]


@pytest.mark.parametrize("gcode", ["M117 G28", "M106 S9", "G10 P0 S200", "M114", 'M98 P"beep.g"', "BEEP"])
def test_a_typed_command_that_keeps_the_position_is_sent_while_the_print_runs(gcode: str) -> None:
    rig = run_with(Rig(LINES), {100: commands.Say(gcode)})

    assert rig.answers == [f"sent {gcode}"]


@pytest.mark.parametrize("park", [True, False])
def test_a_typed_move_is_sent_in_a_pause_whose_end_restores_the_position(park: bool) -> None:
    rig = Rig(tower(6))
    rig.connect()
    steps = iter((commands.Say("G28 X Y"), commands.Resume()))

    def turn(_: float) -> None:
        if rig.streamer.acknowledged == 60 and not rig.answers:
            rig.submit(commands.Pause(park=park))
        elif rig.controller.phase is PrintPhase.PAUSED and (step := next(steps, None)) is not None:
            rig.submit(step)

    rig.run(turn)

    assert isinstance(rig.answers[1], str if park else UsageError)
    assert ("G28 X Y" in rig.executed) == park


def test_an_emergency_stop_that_is_typed_as_gcode_is_an_emergency_stop() -> None:
    assert commands.parse_command("say m112") == commands.Abort()


def test_an_emergency_stop_goes_out_with_a_full_window_and_a_full_planner() -> None:
    rig = run_with(Rig(LINES), {100: commands.Abort()})

    assert isinstance(rig.events[-1], Halted)
    rig.port.read(1.0)
    assert rig.printer.report().killed


def test_the_status_tells_what_a_person_wants_to_know() -> None:
    rig = run_with(Rig(tower(4, labels=True)), {60: commands.Status()})
    status = json.loads(str(rig.answers[0]))

    assert status["state"] == "streaming"
    assert status["total"] == len(rig.commands)
    assert 60 <= status["done"] <= 70
    assert status["temperatures"]["T"][1] == 200
    assert status["objects"] == ["tower id:0 copy 0"]


# Temperatures


def seconds_of(rig: Rig, *, quiet: bool = False) -> float:
    """How long a print takes, with or without anybody asking for temperatures."""
    rig.connect()
    if quiet:
        rig.controller._identified = lambda _: None  # type: ignore[method-assign]
    rig.run()
    assert rig.of_job() == rig.text.split("\n")[:-1]
    return rig.port.now()


NO_REPORTS = replace(MARLIN_2_0_AVR, name="without reports")


@pytest.mark.parametrize(("reports", "baud"), crossed([True, False], [115_200, 250_000]))
def test_temperatures_cost_less_than_2_percent(
    reports: bool, baud: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "".join(f"M117 a line of the usual length {i:05d}\n" for i in range(6000))
    if not reports:
        monkeypatch.setattr("printer_slicer.sim.simulated_firmware._PRESENT", frozenset())
    watched = Rig(text, MARLIN_2_0_AVR, baud=baud)

    with_ = seconds_of(watched)
    without = seconds_of(Rig(text, MARLIN_2_0_AVR, baud=baud), quiet=True)

    assert with_ > 12
    assert sum(isinstance(event, Temperature) for event in watched.events) >= with_ / 6
    assert with_ / without < 1.02


# Requests of the printer


def told(rig: Rig, *events: Event) -> None:
    """The printer says something, at command 50 of the job."""
    rig.connect()
    left = list(events)

    def turn(now: float) -> None:
        if rig.streamer.acknowledged >= 50 and left:
            rig.controller._now = now
            while left:
                rig.controller.on_event(left.pop(0))
        if rig.controller.phase is PrintPhase.PAUSED:
            rig.submit(commands.Resume())

    rig.run(turn)


@pytest.mark.parametrize(
    "event",
    [
        Action("pause"),
        Action("filament_runout T0"),
        Action("out_of_filament"),
        Message('echo:Unknown command: "M600"'),
        Message('echo:Unknown command: "M226"'),
    ],
    ids=str,
)
def test_a_printer_that_wants_a_pause_gets_one_off_the_part(event: Event) -> None:
    rig = Rig(tower(4))
    told(rig, event)

    assert sum(isinstance(one, Paused) for one in rig.events) == 1
    assert "G1 X5 Y215 F6000" in rig.of_job()
    assert isinstance(rig.events[-1], Finished)
    if event != Action("pause") and "M226" not in str(event):
        assert any(isinstance(one, StreamWarning) and "filament" in one.text for one in rig.events)


def test_a_printer_that_has_parked_by_itself_goes_on_by_itself() -> None:
    rig = Rig(LINES)
    rig.connect()
    said: list[str] = []

    def turn(now: float) -> None:
        if rig.streamer.acknowledged >= 50 and not said:
            said.append("paused")
            rig.controller.on_event(Action("paused filament_runout 0"))
        elif said == ["paused"] and now > 20:
            said.append("resumed")
            rig.controller.on_event(Action("resumed"))

    rig.run(turn)

    assert rig.of_job() == LINES.split("\n")[:-1]
    assert any(isinstance(event, Resumed) for event in rig.events)


def test_a_prompt_is_shown_with_its_buttons_and_answered_at_once() -> None:
    rig = Rig(LINES)
    rig.connect()
    asked = [
        Action("prompt_begin Filament runout T0"),
        Action("prompt_button Purge More"),
        Action("prompt_button Continue"),
        Action("prompt_show"),
    ]

    def turn(_: float) -> None:
        if rig.streamer.acknowledged >= 50 and asked:
            while asked:
                rig.controller.on_event(asked.pop(0))
            rig.submit(commands.Answer(1))

    rig.run(turn)
    (prompt,) = (event for event in rig.events if isinstance(event, Prompt))

    assert prompt == Prompt("Filament runout T0", ("Purge More", "Continue"))
    assert "M876 S1" in rig.executed
    assert [line for line in rig.of_job() if line != "M876 S1"] == LINES.split("\n")[:-1]


def test_nobody_is_answered_who_does_not_ask() -> None:
    rig = run_with(Rig(LINES), {50: commands.Answer(0)})

    assert isinstance(rig.answers[0], UsageError)


# Things that are given up

MARKS = {
    "octoprint": ("; printing object {0} id:{1} copy 0", "; stop printing object {0} id:{1} copy 0"),
    "m486": ("M486 S{1}\nM486 A{0}", "M486 S-1"),
    "exclude_object": ("EXCLUDE_OBJECT_START NAME={0}", "EXCLUDE_OBJECT_END NAME={0}"),
}


def three_posts(layers: int, marks: str, *, relative: bool) -> str:
    """Three square posts, each marked, with retracted travels between them."""
    begin, end = MARKS[marks]
    text = ["M104 S200", "M109 S200", "G28", "G90", "M83" if relative else "M82", "G92 E0", "G1 E2 F300"]
    e = 2.0

    def forward(length: float) -> str:
        nonlocal e
        e += length
        return f"E{length if relative else e:.5f}"

    for layer in range(layers):
        text.append(f"G1 Z{0.2 * (layer + 1):.1f} F600")
        for post, x in enumerate((40, 100, 160)):
            text.append(f"G1 {forward(-0.8)} F2100")
            text.append(f"G1 X{x} Y50 F7200")
            text += begin.format(f"post{post}", post).split("\n")
            text.append(f"G1 {forward(0.8)} F1500")
            text.append(f"M106 S{100 + layer}")
            text.append("G1 F2400")
            text += [
                f"G1 X{x + dx} Y{50 + dy} {forward(0.3)}"
                for dx, dy in ((5, 0), (10, 0), (10, 5), (10, 10), (5, 10), (0, 10), (0, 5), (0, 0))
            ]
            text.append(end.format(f"post{post}", post))
    return "\n".join([*text, "M107", "M104 S0"]) + "\n"


@pytest.mark.parametrize("relative", [True, False], ids=["relative E", "absolute E"])
@pytest.mark.parametrize("marks", MARKS)
def test_a_thing_that_is_given_up_is_printed_no_further_and_the_others_as_if_it_were_there(
    marks: str, relative: bool
) -> None:
    text = three_posts(6, marks, relative=relative)
    firmware = replace(MARLIN_2_1, ignores_extended=True)
    whole = Rig(text, firmware)
    whole.connect()
    whole.run()
    name = find_object_spans(text.encode())[1].name

    rig = run_with(Rig(text, firmware), {150: commands.CancelObject(name)})

    done = [bead for bead in rig.beads if 95 < bead[1][0] < 115]
    all_of_it = [bead for bead in whole.beads if 95 < bead[1][0] < 115]
    others = [bead for bead in rig.beads if not 95 < bead[1][0] < 115]
    assert 0 < len(done) < len(all_of_it)
    assert done[:-1] == all_of_it[: len(done) - 1]
    assert len(others) == len(all_of_it) * 2
    expected = laid([bead for bead in whole.beads if not 95 < bead[1][0] < 115])
    for one, other in zip(laid(others), expected, strict=True):
        assert one[0][:3] == pytest.approx(other[0][:3], abs=1e-6)
        assert one[1][:3] == pytest.approx(other[1][:3], abs=1e-6)
        assert one[1][3] - one[0][3] == pytest.approx(other[1][3] - other[0][3], abs=1e-5)
    assert isinstance(rig.events[-1], Finished)
    assert rig.events[-1].verified
    # Never still above the thing that was left.
    assert rig.printer._state.statistics.n_violations == 0


def test_the_nozzle_does_not_wait_on_the_part_while_lines_are_left_out() -> None:
    """Without the lines, the next thing's first move follows within the time of a few lines."""
    text = three_posts(40, "octoprint", relative=True)
    rig = Rig(text)
    rig.connect()
    turns: list[tuple[float, int]] = []

    def turn(now: float) -> None:
        if rig.streamer.acknowledged >= 150 and not rig.controller._job.cancelled:
            rig.submit(commands.CancelObject("post1 id:1 copy 0"))
        turns.append((now, rig.streamer.acknowledged))

    rig.run(turn)
    jumps = [(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(turns) if b[1] - a[1] > 3]

    assert jumps
    assert rig.printer.report().underruns <= 2


def test_a_thing_that_is_not_there_is_refused_with_those_that_are() -> None:
    rig = run_with(Rig(three_posts(3, "m486", relative=True)), {20: commands.CancelObject("cube")})

    assert isinstance(rig.answers[0], UsageError)
    assert "post0, post1, post2" in str(rig.answers[0])


def test_klipper_leaves_things_out_by_itself() -> None:
    text = three_posts(3, "exclude_object", relative=True).replace(
        "M109 S200\n", "M109 S200\nEXCLUDE_OBJECT_DEFINE NAME=post0\n"
    )
    rig = Rig(text, replace(MARLIN_2_1, ignores_extended=True), setup=replace(SETUP, flavour="klipper"))
    run_with(rig, {30: commands.CancelObject("post1")})

    assert "EXCLUDE_OBJECT NAME=post1" in rig.of_job()
    assert len(rig.of_job()) == len(rig.commands) + 1


def test_a_file_without_marks_has_no_things() -> None:
    job = LiveJob([b"G28"], find_object_spans(b"G28\n"))

    assert job.object_names == []
    with pytest.raises(UsageError, match="no object"):
        job.cancel_object("0", 0)


# Parsing of commands


@pytest.mark.parametrize(
    ("line", "command"),
    [
        ("pause", commands.Pause()),
        ("pause now cold", commands.Pause(now=True, cold=True)),
        ("pause here", commands.Pause(park=False)),
        (" resume ", commands.Resume()),
        ("object my part", commands.CancelObject("my part")),
        ("speed 80", commands.Speed(80)),
        ("speed 120%", commands.Speed(120)),
        ("flow 95 %", commands.Flow(95)),
        ("fan 50%", commands.SetFan(50)),
        ("nozzle 210C", commands.SetTemperature("nozzle", 210)),
        ("bed 60°C", commands.SetTemperature("bed", 60)),
        ("babystep 0.05mm", commands.BabyStep(0.05)),
        ("nozzle 210.5", commands.SetTemperature("nozzle", 210.5)),
        ("babystep -0.02", commands.BabyStep(-0.02)),
        ("say M117 hello", commands.Say("M117 hello")),
        ("abort", commands.Abort()),
        ("m112", commands.Abort()),
        ("stop", commands.Abort()),
        ("cancel", commands.Cancel()),
    ],
)
def test_wishes_are_read(line: str, command: commands.PrintCommand) -> None:
    assert commands.parse_command(line) == command


@pytest.mark.parametrize(
    "line",
    [
        "",
        "dance",
        "pause soon",
        "resume now",
        "speed",
        "speed fast",
        "speed nan",
        "speed %",
        "answer 1%",
        "speed 5",
        "say",
        "say a\x07",
    ],
)
def test_nonsense_is_refused_with_a_remedy(line: str) -> None:
    with pytest.raises(UsageError) as caught:
        commands.parse_command(line)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("pauze", "pause"),
        ("temperature", "nozzle"),
        ("hotend", "nozzle"),
        ("temp", "nozzle"),
        ("z", "babystep"),
        ("cancle", "cancel"),
    ],
)
def test_an_unknown_command_gets_a_suggestion(word: str, meant: str) -> None:
    with pytest.raises(UsageError) as caught:
        commands.parse_command(f"{word} 205")

    assert caught.value.remedy.startswith(f"Did you mean {meant!r}? Use one of ")


def test_a_word_with_no_similar_command_gets_no_suggestion() -> None:
    with pytest.raises(UsageError) as caught:
        commands.parse_command("dance")

    assert caught.value.remedy.startswith("Use one of ")


def test_what_is_paused_or_prints_already_says_so() -> None:
    rig = Rig(LINES)
    rig.connect()
    left = [commands.Resume(), commands.Pause(), commands.Pause(), commands.Resume()]

    def turn(_: float) -> None:
        ready = rig.streamer.acknowledged >= 50
        if ready and left and (len(left) > 2 or rig.controller.phase is PrintPhase.PAUSED):
            rig.submit(left.pop(0))

    rig.run(turn)

    assert [str(answer) for answer in rig.answers] == [
        "cannot resume: the print is streaming\n  Run printer-slicer control status",
        "pausing after the planned moves",
        "cannot pause: the print is paused\n  Run printer-slicer control status",
        "resuming",
    ]
    assert isinstance(rig.events[-1], Finished)


def test_a_wish_that_nobody_hears_is_given_up() -> None:
    with pytest.raises(UsageError) as caught:
        Controls().ask(commands.Pause(), timeout=0.01)

    assert str(caught.value) == "the print process does not respond\n  Check that the printer is connected"
