"""Settings that are lists, and the flags for layer heights: read, written back, and refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.cli.parser import build_parser
from printer_slicer.errors import ProfileError
from printer_slicer.mesh_io import export_stl
from printer_slicer.profile import OptimalPlanner, Profile, list_settings, load_profile, profile_with
from printer_slicer.profile.lists import format_list, parse_list
from tests.cli.command_line import BOX, Outcome, is_message, typed
from tests.parts import sphere
from tests.waiting import comes_back

HEIGHTS, RANGES = "layer_heights", "planner.ranges"


def loaded(**changes: Any) -> Profile:
    return load_profile(
        "marlin_220", "pla", "adaptive", {key.replace("__", "."): value for key, value in changes.items()}
    )


def ranges_of(profile: Profile) -> list[tuple[float, float, float, float]]:
    planner = profile.quality.planner
    assert isinstance(planner, OptimalPlanner)
    return [(one.low, one.high, one.tolerance, one.layer_height) for one in planner.ranges]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.1, 0.2, 0.3", [0.1, 0.2, 0.3]),
        ("0.1,0.2", [0.1, 0.2]),
        (" 0.15 ", [0.15]),
        ("0.1, 0.2,", [0.1, 0.2]),
        ("1e-1", [0.1]),
        ("", []),
        ("  ", []),
    ],
)
def test_heights_are_numbers_between_commas(text: str, expected: list[float]) -> None:
    assert parse_list(HEIGHTS, text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1:3:tolerance=0.05", [{"low": 1, "high": 3, "tolerance": 0.05}]),
        (" 1 : 3 : layer_height = 0.1 ", [{"low": 1, "high": 3, "layer_height": 0.1}]),
        (
            "1:3:tolerance=0.05:layer_height=0.1",
            [{"low": 1, "high": 3, "tolerance": 0.05, "layer_height": 0.1}],
        ),
        (
            "0:1:layer_height=0.1; 2:3:tolerance=0.02;",
            [{"low": 0, "high": 1, "layer_height": 0.1}, {"low": 2, "high": 3, "tolerance": 0.02}],
        ),
        ("", []),
    ],
)
def test_ranges_are_two_heights_and_rules_between_semicolons(text: str, expected: list[Any]) -> None:
    assert parse_list(RANGES, text) == expected


@pytest.mark.parametrize(
    ("key", "text"),
    [
        (HEIGHTS, "thin"),
        (HEIGHTS, "0.1; 0.2"),
        (HEIGHTS, "0.1 0.2"),
        (HEIGHTS, "0,1 mm"),
        (HEIGHTS, ","),
        (RANGES, " ; "),
        (RANGES, "1"),
        (RANGES, "1:3"),
        (RANGES, "1:3:"),
        (RANGES, "1:3:tolerance"),
        (RANGES, "1:3:tolerance="),
        (RANGES, "1:3:width=0.1"),
        (RANGES, "a:3:tolerance=0.1"),
        (RANGES, "1-3:tolerance=0.1"),
        (RANGES, "1:3:tolerance=0.1,5:6:tolerance=0.1"),
    ],
)
def test_text_that_is_no_list_is_refused_by_key_with_an_example(key: str, text: str) -> None:
    with pytest.raises(ProfileError) as caught:
        parse_list(key, text)

    assert key in str(caught.value)
    assert text in str(caught.value)
    assert parse_list(key, caught.value.remedy.partition(": ")[2])


def test_numbers_of_numpy_are_numbers() -> None:
    changes = {
        "tolerance": np.float32(0.25),
        "perimeters": np.int64(3),
        "layer_heights": np.array([0.1, 0.25]),
    }
    quality = load_profile(None, None, None, changes).quality

    assert (quality.tolerance, quality.perimeters, quality.layer_heights) == (0.25, 3, (0.1, 0.25))


@pytest.mark.parametrize("key", ["max_step", "planner.max_step", "quality.planner.max_step"])
def test_a_setting_of_another_planner_is_answered_with_the_planner(key: str) -> None:
    with pytest.raises(ProfileError, match="the chosen planner has no such setting") as refused:
        load_profile(None, None, None, {"quality.planner.kind": "cusp", key: 0.02})

    assert '`planner.kind="optimal"`' in str(refused.value)


@pytest.mark.parametrize("key", ["max_step", "planner.max_step", "quality.planner.max_step"])
def test_a_setting_of_the_chosen_planner_may_be_named_alone(key: str) -> None:
    assert load_profile(None, None, None, {key: 0.02}).dials.max_step == 0.02


@pytest.mark.parametrize("text", ["nan", "0.1, inf", "-0.1", "0", "5"])
def test_heights_that_no_printer_has_are_refused(text: str) -> None:
    with pytest.raises(ProfileError) as caught:
        loaded(layer_heights=text)

    assert "layer_heights" in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    "text",
    [
        "nan:3:tolerance=0.1",
        "1:nan:tolerance=0.1",
        "1:3:tolerance=nan",
        "1:inf:tolerance=0.1",
        "-1:3:tolerance=0.1",
        "1:3:tolerance=-0.1",
        "1:3:tolerance=9",
        "3:3:tolerance=0.1",
        "3:1:tolerance=0.1",
    ],
)
def test_ranges_that_are_none_are_refused(text: str) -> None:
    with pytest.raises(ProfileError) as caught:
        loaded(planner__ranges=text)

    assert "ranges" in str(caught.value)
    assert caught.value.remedy


def test_what_is_wrong_in_a_changed_range_is_not_blamed_on_the_file_of_the_profile() -> None:
    with pytest.raises(ProfileError) as caught:
        loaded(planner__ranges="1:3:tolerance=9")

    assert "adaptive.toml" not in str(caught.value)


def test_lists_from_text_and_from_tables_are_the_same() -> None:
    text = loaded(layer_heights="0.1, 0.2", planner__ranges="1:3:tolerance=0.05")
    tables = loaded(layer_heights=[0.1, 0.2], planner__ranges=[{"low": 1, "high": 3, "tolerance": 0.05}])

    assert text == tables
    assert ranges_of(text) == [(1, 3, 0.05, 0)]


def test_lists_are_read_from_files(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(
        'inherits = "adaptive"\nname = "mine"\nlayer_heights = [0.1, 0.3]\n'
        '[planner]\nkind = "optimal"\nranges = [{low = 1, high = 3, layer_height = 0.1}]\n'
    )
    profile = load_profile("marlin_220", "pla", str(file))

    assert profile.quality.layer_heights == (0.1, 0.3)
    assert ranges_of(profile) == [(1, 3, 0, 0.1)]
    emptied = load_profile("marlin_220", "pla", str(file), {"layer_heights": "", "planner.ranges": ""})
    assert emptied.quality.layer_heights == ()
    assert ranges_of(emptied) == []


def test_thinnest_and_thickest_are_those_of_the_list() -> None:
    profile = loaded(layer_heights="0.3, 0.1, 0.2")

    assert (profile.thinnest, profile.thickest) == (0.1, 0.3)


def test_a_profile_with_lists_can_be_changed_further() -> None:
    profile = loaded(layer_heights="0.1, 0.2", planner__ranges="1:3:tolerance=0.05")
    changed = profile_with(profile, {"quality.tolerance": 0.2})

    assert changed.quality.layer_heights == (0.1, 0.2)
    assert ranges_of(changed) == ranges_of(profile)


# --- rules of files that inherit, and that are typed ---

PARENT = (
    'inherits = "adaptive"\nname = "parent"\n[[overrides]]\nlow = 1\nhigh = 2\nset = { perimeters = 3 }\n'
)


def rules(folder: Path, child: str, **changes: object) -> str:
    """The overrides of a file that inherits from another with one, after changes; + in a key is written _plus."""
    (folder / "parent.toml").write_text(PARENT)
    (folder / "child.toml").write_text(f'inherits = "./parent.toml"\nname = "child"\n{child}')
    added = {key.replace("_plus", "+"): value for key, value in changes.items()}
    profile = load_profile("marlin_220", "pla", str(folder / "child.toml"), added)
    return str(dict(list_settings(profile))["quality.overrides"])


@pytest.mark.parametrize(
    ("child", "changes", "expected"),
    [
        ("", {}, "1:2:perimeters=3"),
        ('[[overrides]]\nobject = "lid"\nset = {perimeters = 4}', {}, "1:2:perimeters=3; lid:perimeters=4"),
        ('overrides = "lid:perimeters=4"', {}, "1:2:perimeters=3; lid:perimeters=4"),
        ("overrides = []", {}, ""),
        ("", {"overrides_plus": "1:2:perimeters=5"}, "1:2:perimeters=3; 1:2:perimeters=5"),
        ("", {"overrides": "1:2:perimeters=5"}, "1:2:perimeters=5"),
        ("", {"overrides": ""}, ""),
        (
            "",
            {"overrides_plus": "a:infill=grid", "overrides": "b:infill=grid"},
            "b:infill=grid; a:infill=grid",
        ),
    ],
)
def test_rules_of_places_add_up_and_the_later_ones_come_last(
    tmp_path: Path, child: str, changes: dict[str, object], expected: str
) -> None:
    assert rules(tmp_path, child, **changes) == expected


def test_an_added_rule_wins_over_those_that_are_there() -> None:
    """Layer by layer it is what is typed, as if the file did not say otherwise; what it does not say stays."""
    profile = loaded(planner__ranges="1:5:layer_height=0.1:tolerance=0.04; 7:8:layer_height=0.1")
    text = {"planner.ranges+": "2:3:layer_height=0.2; 6:9:layer_height=0.3"}

    assert ranges_of(profile_with(profile, text)) == [
        (1, 5, 0.04, 0),
        (1, 2, 0, 0.1),
        (3, 5, 0, 0.1),
        (2, 3, 0, 0.2),
        (6, 9, 0, 0.3),
    ]


def test_lists_may_be_text_in_files(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'inherits = "adaptive"\nname = "mine"\nlayer_heights = "0.1, 0.3"\n'
        '[planner]\nkind = "optimal"\nranges = "1:3:layer_height=0.1"\n'
    )
    profile = load_profile("marlin_220", "pla", str(path))

    assert profile.quality.layer_heights == (0.1, 0.3)
    assert ranges_of(profile) == [(1, 3, 0, 0.1)]


# --- written back ---

lengths = st.integers(0, 2_000_000).map(lambda steps: steps / 10_000)  # to 0.0001 mm, up to 200 mm


@given(st.lists(st.integers(100, 16_000).map(lambda steps: steps / 10_000), max_size=5))
def test_heights_are_written_as_they_are_read(heights: list[float]) -> None:
    assert parse_list(HEIGHTS, format_list(heights)) == heights


@given(
    st.lists(
        st.fixed_dictionaries(
            {"low": lengths, "high": lengths.filter(bool)},
            optional={"tolerance": lengths.filter(bool), "layer_height": lengths.filter(bool)},
        ).filter(lambda table: len(table) > 2),
        max_size=3,
    )
)
def test_ranges_are_written_as_they_are_read(tables: list[dict[str, float]]) -> None:
    assert parse_list(RANGES, format_list(tables)) == tables


def test_a_range_without_rules_of_its_own_is_written_so_that_it_can_be_read() -> None:
    """Files may have one; layers end at its ends."""
    table = {"low": 1.0, "high": 3.0, "tolerance": 0.0, "layer_height": 0.0}
    text = format_list([table])

    read = parse_list(RANGES, text)[0]
    assert math.isclose(read["low"], 1)
    assert math.isclose(read["high"], 3)


def test_the_settings_of_a_profile_as_text_make_the_same_profile_again() -> None:
    profile = loaded(
        layer_heights="0.1, 0.125, 0.2", planner__ranges="1:3:tolerance=0.05; 12.3457:100.255:tolerance=0.03"
    )
    said = dict(list_settings(profile))
    again = profile_with(profile, {key: value for key, value in said.items() if "gcode" not in key})

    assert ranges_of(again) == ranges_of(profile)
    assert again == profile


# --- as flags ---

USUAL = ("--printer", "marlin_220", "--material", "pla", "--quality", "adaptive", "--set", "z_step=0.01")


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lists") / "ball.stl"
    export_stl(sphere(2.5), path)
    return path


def plan_command(*flags: str, model: object = BOX) -> Outcome:
    return typed("plan", model, "--json", *USUAL, *flags)


def heights_of(outcome: Outcome) -> Float:
    assert outcome.code == 0, outcome.err
    layers = json.loads(outcome.out)["layers"]
    return np.asarray(np.round(np.array(layers["top"]) - np.array(layers["bottom"]), 6))


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("0.1,0.2", (0.1, 0.2)),
        ("0.2", (0.2,)),
        ("0.1:0.3", tuple(i / 100 for i in range(10, 31))),
        ("0.1:0.3:0.05", (0.1, 0.15, 0.2, 0.25, 0.3)),
    ],
)
def test_heights_are_typed_as_a_list_a_range_or_a_range_with_steps(
    text: str, allowed: tuple[float, ...], ball: Path
) -> None:
    heights = heights_of(plan_command("--heights", text, "--first-layer", "0.2", model=ball))

    assert set(heights[2:-2].tolist()) <= set(allowed)


def test_tolerance_objective_containment_and_first_layer_are_typed(ball: Path) -> None:
    outcome = plan_command("--tolerance", "0.05", "--objective", "layers", "--first-layer", "0.1", model=ball)

    assert heights_of(outcome)[0] == pytest.approx(0.1)
    assert json.loads(outcome.out)["certificate"]["max_error_mm"] <= 0.05 + 1e-6
    one_sided = plan_command("--containment", "positive", "--tolerance", "0.1", model=ball)
    assert len(heights_of(one_sided)) > len(heights_of(outcome))


def test_ranges_may_be_typed_one_by_one() -> None:
    outcome = plan_command("--range", "1:3:layer_height=0.1", "--range", "5:6:layer_height=0.2")
    heights = heights_of(outcome)
    bottom = np.cumsum(heights) - heights

    assert heights[(bottom > 0.99) & (bottom < 2.99)] == pytest.approx(0.1)
    assert heights[(bottom > 4.99) & (bottom < 5.99)] == pytest.approx(0.2)


def test_ranges_that_are_typed_leave_those_of_the_file_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text(
        'inherits = "adaptive"\nname = "own"\noverrides = "1:2:perimeters=3"\n'
        '[planner]\nkind = "optimal"\nranges = "1:3:layer_height=0.1"\n'
    )
    flags = (
        "--range",
        "5:6:layer_height=0.2",
        "--range",
        "5:6:perimeters=4",
        "--set-for",
        "box:perimeters=5",
    )
    out = tmp_path / "box.gcode"
    outcome = typed("slice", BOX, "-o", out, "--quality", path, "--set", "z_step=0.01", *flags)
    said = out.read_text()

    assert outcome.code == 0, outcome.err
    assert "; quality.planner.ranges = 1:3:layer_height=0.1; 5:6:layer_height=0.2\n" in said
    assert "; quality.overrides = 1:2:perimeters=3; box:perimeters=5; 5:6:perimeters=4\n" in said


def test_the_number_of_layers_is_typed(ball: Path) -> None:
    assert len(heights_of(plan_command("--max-layers", "20", model=ball))) <= 20


@pytest.mark.parametrize("text", ["90m", "1h30m", "5400", "1.5h", "5400s", "90min"])
def test_a_time_is_typed_in_hours_minutes_or_seconds(text: str) -> None:
    arguments = build_parser().parse_args(["plan", "part.stl", "--time-budget", text])

    assert vars(arguments)["setting quality.planner.time_budget"] == 5400


def test_more_time_than_the_ball_takes_is_no_error(ball: Path) -> None:
    assert len(heights_of(plan_command("--time-budget", "90m", model=ball))) > 0


def test_less_time_than_the_box_takes_is_answered_all_the_same() -> None:
    with comes_back():
        outcome = typed("plan", BOX, *USUAL, "--time-budget", "45s")

    assert outcome.code in (0, 3)


def test_a_time_of_an_hour_and_a_number_is_not_taken_for_seconds() -> None:
    """Nobody who types 1h30 means an hour and 30 seconds; an hour and a half, or a refusal, will do."""
    try:
        arguments = build_parser().parse_args(["plan", "part.stl", "--time-budget", "1h30"])
    except SystemExit:
        return

    assert vars(arguments)["setting quality.planner.time_budget"] == 5400


BAD: Final[list[tuple[str, str, str]]] = [
    ("--tolerance", "nan", "tolerance"),
    ("--tolerance", "0", "tolerance"),
    ("--tolerance", "-1", "tolerance"),
    ("--tolerance", "0,05", "tolerance"),
    ("--tolerance", "", "tolerance"),
    ("--heights", ":", "est_layer"),
    ("--heights", "0.1:", "est_layer"),
    ("--heights", "0.3:0.1", "thinnest_layer"),
    ("--heights", "0.1:0.2:0.02:5", "heights"),
    ("--heights", "a", "heights"),
    ("--heights", "0.1,nan", "heights"),
    ("--heights", "nan:nan", "thinnest_layer"),
    ("--heights", "0.1:0.2:-0.02", "layer_step"),
    ("--heights", "0.1:0.2:0.015", "layer_step"),
    ("--range", "1:3", "ranges"),
    ("--range", "x", "ranges"),
    ("--range", "3:1:tolerance=0.05", "ranges"),
    ("--range", "1:3:tolerance=nan", "ranges"),
    ("--range", "nan:3:tolerance=0.1", "ranges"),
    ("--range", "1:3:layer_height=5", "ranges"),
    ("--max-layers", "x", "--max-layers "),
    ("--max-layers", "2.5", "--max-layers "),
    ("--objective", "fast", "objective"),
    ("--containment", "both", "containment"),
    ("--planner", "best", "planner"),
    ("--snap", "nan", "--snap "),
    ("--max-step", "-1", "--max-step "),
    ("--error-price", "inf", "--error-price "),
    ("--first-layer", "0.9", "--first-layer "),
    ("--time-budget", "99999999999h", "--time-budget "),
]


@pytest.mark.parametrize(("flag", "value", "key"), BAD)
def test_bad_values_are_refused_by_name_with_a_remedy(flag: str, value: str, key: str) -> None:
    outcome = plan_command(flag, value)

    assert outcome.code == 2, outcome.err
    assert outcome.out == ""
    assert is_message(outcome, key)
    assert len(outcome.err.splitlines()) >= 2


@pytest.mark.parametrize("value", ["soon", "1d", "nan", "-5", "", "1h30q", "30m1h", ".", "1.5.2h", "1..m"])
def test_times_that_are_none_are_refused_with_an_example(value: str) -> None:
    outcome = plan_command("--time-budget", value)

    assert outcome.code == 2
    assert "Traceback" not in outcome.err
    assert "--time-budget" in outcome.err
    assert "_seconds" not in outcome.err
    if value != "-5":  # looks like a flag
        assert "1h30m" in outcome.err


@pytest.mark.parametrize("flag", ["--objective", "--containment", "--planner"])
def test_a_word_that_is_no_choice_is_answered_with_the_choices(flag: str) -> None:
    choices = {"--objective": "balanced", "--containment": "positive", "--planner": "optimal"}

    assert choices[flag] in plan_command(flag, "fast").err


def test_a_tolerance_of_a_range_that_cannot_be_kept_is_reported(ball: Path) -> None:
    """A sphere cannot be within 0.005 mm; the rest of it is within the usual tolerance."""
    outcome = plan_command("--range", "2:4:tolerance=0.005", model=ball)
    over = json.loads(outcome.out)["certificate"]["over_tolerance"]

    assert any(stretch["from"] < 4 and stretch["to"] > 2 for stretch in over)


def test_too_few_layers_end_with_the_code_of_parts_that_cannot_be_sliced() -> None:
    outcome = plan_command("--max-layers", "3")

    assert outcome.code == 3
    assert is_message(outcome, "3 layers")


@pytest.mark.parametrize(("typed", "value"), [(".5", 0.5), ("1.", 1.0), ("+.25", 0.25)])
def test_numbers_may_be_typed_without_a_digit_beside_the_point(typed: str, value: float) -> None:
    assert load_profile(changes={"printer.z_hop": typed}).printer.z_hop == value


@pytest.mark.parametrize("typed", [".", "..5", "-."])
def test_a_point_alone_is_no_number(typed: str) -> None:
    with pytest.raises(ProfileError, match="z_hop"):
        load_profile(changes={"printer.z_hop": typed})
