"""Profiles: inheritance, changes, bounds, and errors that tell file, key and bound."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterator
from contextlib import chdir
from itertools import product
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.planning import PLANNERS
from printer_slicer.profile import (
    KINDS,
    AreaPlanner,
    Profile,
    UniformPlanner,
    find_profile_paths,
    list_settings,
    load_profile,
    profile_with,
)
from printer_slicer.profile.settings import PLANNER_SETTINGS
from printer_slicer.profile.tables import list_setting_definitions

ROOT = Path(__file__).parents[2]
PRINTERS, MATERIALS, QUALITIES = (list(find_profile_paths(kind)) for kind in KINDS)
USUAL = load_profile("marlin_220", "pla", "standard")
ROWS = {row[0]: row for row in list_setting_definitions()}
BOUNDED = [row for row in ROWS.values() if re.search(r"[<>]", row[3])]

Write = Callable[[str, str], str]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Writes a file and gives its path as text."""

    def write_text(name: str, text: str) -> str:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write_text


def refused(
    printer: str | None = None, material: str | None = None, quality: str | None = None, **changes: object
) -> str:
    """The message of a profile that must be refused."""
    changed = {key.replace("__", "."): value for key, value in changes.items()}
    with pytest.raises(ProfileError) as caught:
        load_profile(printer, material, quality, changed)
    assert caught.value.exit_code == 2
    return str(caught.value)


def attempt(make: Callable[[], Profile]) -> Profile | ProfileError:
    """The profile, or why there is none."""
    try:
        return make()
    except ProfileError as error:
        return error


def numbers(text: str) -> set[float]:
    return {float(number) for number in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", text)}


def test_the_planners_of_the_settings_are_those_that_exist() -> None:
    assert set(PLANNER_SETTINGS) == set(PLANNERS)


# Inheritance and order


def test_a_file_wins_over_the_one_it_inherits_from(write: Write) -> None:
    path = write("mine.toml", 'inherits = "marlin_220"\nname = "mine"\nbed_x = 180\n')

    printer = load_profile(path).printer

    assert (printer.name, printer.bed_x) == ("mine", 180)
    assert printer.bed_y == load_profile("marlin_220").printer.bed_y
    assert printer.start_gcode == load_profile("marlin_220").printer.start_gcode


def test_inheritance_goes_through_several_files(write: Write) -> None:
    first = write("first.toml", 'inherits = "strong"\nperimeters = 5\nskirt_loops = 3\n')
    second = write("second.toml", f'inherits = "{first}"\nskirt_loops = 2\n')

    quality = load_profile(quality=second).quality

    assert (quality.skirt_loops, quality.perimeters) == (2, 5)
    assert quality.top_thickness == load_profile(quality="strong").quality.top_thickness
    assert quality.infill_density == load_profile(quality="strong").quality.infill_density


def test_a_path_in_inherits_is_beside_the_file_that_says_it(write: Write, tmp_path: Path) -> None:
    write("sub/base.toml", 'inherits = "standard"\nperimeters = 7\n')
    top = write("sub/top.toml", 'inherits = "base.toml"\n')

    with chdir(tmp_path):
        assert load_profile(quality=top).quality.perimeters == 7


def test_tables_are_merged_key_by_key(write: Write) -> None:
    path = write("q.toml", 'inherits = "standard"\n[speeds]\ntravel = 99\n')

    speeds = load_profile(quality=path).quality.speeds

    assert speeds.travel == 99
    assert speeds.internal_infill == USUAL.quality.speeds.internal_infill


def test_a_planner_of_the_same_kind_is_merged_and_one_of_another_kind_replaced(write: Write) -> None:
    base = write(
        "base.toml", 'inherits = "standard"\n[planner]\nkind = "area"\ntolerance = 0.5\naligned = true\n'
    )
    same = write("same.toml", f'inherits = "{base}"\n[planner]\naligned = false\n')
    other = write("other.toml", f'inherits = "{base}"\n[planner]\nkind = "uniform"\n')

    assert load_profile(quality=same).quality.planner == AreaPlanner(tolerance=0.5, aligned=False)
    assert load_profile(quality=other).quality.planner == UniformPlanner()


def test_changes_come_last(write: Write) -> None:
    path = write("q.toml", 'inherits = "strong"\nperimeters = 6\n')

    assert load_profile(quality=path).quality.perimeters == 6
    assert load_profile(quality=path, changes={"perimeters": "3"}).quality.perimeters == 3


def test_a_later_change_of_the_same_setting_wins() -> None:
    changes = {"perimeters": "3", "quality.perimeters": "4"}

    assert load_profile(changes=changes).quality.perimeters == 4


@pytest.mark.parametrize("order", [1, -1])
def test_a_planner_and_its_settings_can_be_given_in_any_order(order: int) -> None:
    changes = [("planner.kind", "area"), ("planner.tolerance", "0.25")]

    planner = load_profile(quality="standard", changes=dict(changes[::order])).quality.planner

    assert planner == AreaPlanner(tolerance=0.25)


def test_a_change_with_its_section_is_the_same_as_without() -> None:
    assert load_profile(changes={"infill_density": 0.3}) == load_profile(
        changes={"quality.infill_density": 0.3}
    )


# Errors: the file, the key, the bound


def test_a_key_of_several_sections_must_say_which() -> None:
    message = refused(name="x")

    assert all(f"{kind}.name" in message for kind in KINDS)


def test_a_misspelt_change_offers_the_near_name() -> None:
    assert "infill_density" in refused(infil_densty="0.2")
    assert "speeds.travel" in refused(speeds__travle="90")


def test_an_unknown_change_tells_what_lists_all_settings() -> None:
    assert "`ps.find_settings()`" in refused(nothing_like_it="1")


def test_a_table_cannot_be_changed_as_a_whole() -> None:
    assert "speeds" in refused(speeds="3")
    assert "planner" in refused(planner="area")


@pytest.mark.parametrize("kind", KINDS)
def test_an_unknown_name_lists_the_known_ones(kind: str) -> None:
    asked: list[str | None] = [None, None, None]
    asked[list(KINDS).index(kind)] = "no_such_thing"
    message = refused(*asked)

    names = () if kind == "printer" else find_profile_paths(kind)  # there are too many printers for a message
    assert all(name in message for name in ("no_such_thing", kind, *names))


def test_a_near_name_is_offered() -> None:
    assert "Did you mean marlin_220 (" in refused("marlin_22")


@pytest.mark.parametrize("text", ["", "# only a comment\n"])
def test_a_profile_without_what_it_must_have_names_file_and_key(write: Write, text: str) -> None:
    path = write("empty.toml", text)
    message = refused(path)

    assert path in message
    assert "name" in message


@pytest.mark.parametrize(
    ("text", "key", "bound"),
    [
        ("perimeters = 101", "quality.perimeters", "100"),
        ("infill_density = -0.1", "quality.infill_density", "0"),
        ("[speeds]\ntravel = -1", "quality.speeds.travel", ">= 0"),
        ('[planner]\nkind = "area"\nrelative_tolerance = 2', "quality.planner.relative_tolerance", "1"),
        ('seam = "front"', "quality.seam", "rear"),
        ('[planner]\nkind = "cosp"', "quality.planner.kind", "uniform, area"),
        ("perimeters = true", "quality.perimeters", "a whole number"),
        ("perimeters = 2.5", "quality.perimeters", "a whole number"),
        ("perimeters = []", "quality.perimeters", "a whole number"),
        ("external_perimeter_first = 2", "quality.external_perimeter_first", "true or false"),
        ("name = 3", "quality.name", "text"),
        ("infill_density = nan", "quality.infill_density", "0"),
        ("infill_density = 2020-01-01", "quality.infill_density", "a number; got 2020-01-01"),
        ('planner = "area"', "quality.planner", "a table"),
        ("speeds = 3", "quality.speeds", "a table"),
    ],
)
def test_a_bad_value_in_a_file_names_file_key_and_bound(
    write: Write, text: str, key: str, bound: str
) -> None:
    path = write("bad.toml", f'inherits = "standard"\n{text}\n')
    message = refused(None, None, path)

    assert all(part in message for part in (path, key, bound))


@pytest.mark.parametrize("text", ['planner = "area"', "speeds = 3", "planner = 3"])
@pytest.mark.parametrize("change", ["perimeters", "planner.kind", "speeds.travel"])
def test_a_value_where_a_table_belongs_is_refused_with_changes_too(
    write: Write, text: str, change: str
) -> None:
    path = write("bad.toml", f'inherits = "standard"\n{text}\n')
    with pytest.raises(ProfileError) as caught:
        load_profile(quality=path, changes={change: "area" if change == "planner.kind" else "3"})

    assert path in str(caught.value)


@pytest.mark.parametrize(
    ("text", "key", "near"),
    [
        ("perimetres = 3", "perimetres", "perimeters"),
        ("[speeds]\ntravl = 3", "speeds.travl", "travel"),
        ("[spedes]\ntravel = 3", "spedes", "speeds"),
        ('[planner]\nkind = "area"\ntolerence = 1', "planner.tolerence", "tolerance"),
        ('[planner]\nkind = "area"\nmax_cusp = 1', "planner.max_cusp", ""),
        ("[quality]\nperimeters = 3", "quality", ""),
    ],
)
def test_an_unknown_key_in_a_file_names_that_file_and_the_near_key(
    write: Write, text: str, key: str, near: str
) -> None:
    path = write("unknown.toml", f'inherits = "standard"\n{text}\n')
    message = refused(None, None, path)

    assert re.match(rf"{re.escape(path)}:[2-4]: ", message)
    assert key in message
    assert near in message


def test_a_bad_value_in_the_inherited_file_names_the_inherited_file(write: Write) -> None:
    base = write("base.toml", 'inherits = "standard"\nperimeters = 500\n')
    top = write("top.toml", f'inherits = "{base}"\nskirt_loops = 2\n')

    assert refused(None, None, top).startswith(f"{base}:2: quality.perimeters")


def test_broken_toml_names_file_and_line(write: Write) -> None:
    path = write("broken.toml", 'name = "x"\nbed_x = = 2\n')

    assert re.search(rf"{re.escape(path)}:2: ", refused(path))


def test_a_file_in_another_encoding_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes('name = "Größe"\n'.encode("latin-1"))

    assert str(path) in refused(str(path))


@pytest.mark.skipif(not Path("/proc/self/mem").exists(), reason="no file that is there and cannot be read")
def test_a_file_that_cannot_be_read_names_it(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.symlink_to("/proc/self/mem")

    with pytest.raises(ProfileError, match=r"mine\.toml: cannot be read: .+ error") as refused:
        load_profile(str(path))
    assert refused.value.remedy == "Check the file's permissions"


def test_a_circle_of_files_is_named(write: Write, tmp_path: Path) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    write("one.toml", f'inherits = "{two}"\n')
    write("two.toml", f'inherits = "{one}"\n')
    message = refused(str(one))

    assert "one.toml" in message
    assert "two.toml" in message


def test_a_file_that_inherits_from_itself_is_refused(write: Write, tmp_path: Path) -> None:
    write("self.toml", 'inherits = "./self.toml"\n')
    with chdir(tmp_path):
        message = refused("./self.toml")

    assert "self.toml" in message


def test_inheriting_from_nothing_known_names_the_file_that_says_so(write: Write) -> None:
    path = write("orphan.toml", 'inherits = "nobody"\n')
    message = refused(path)

    assert path in message
    assert "nobody" in message


@pytest.mark.parametrize("parent", ["3", "true", '["standard"]', "{a = 1}"])
def test_inherits_must_be_a_name(write: Write, parent: str) -> None:
    path = write("odd.toml", f"inherits = {parent}\n")

    assert f"{path}:1: inherits" in refused(path)


@pytest.mark.parametrize("name", ["nowhere.toml", "./nowhere.toml", "dir/nowhere", "a\0b.toml", "."])
def test_a_missing_file_is_named(name: str) -> None:
    assert Path(name).name in refused(name)


def test_a_folder_is_no_profile(tmp_path: Path) -> None:
    (tmp_path / "folder.toml").mkdir()

    assert "folder.toml" in refused(str(tmp_path / "folder.toml"))


# Bounds: every setting that has some


each_bounded_row = pytest.mark.parametrize(
    ("number", "row"), list(enumerate(BOUNDED)), ids=[row[0] for row in BOUNDED]
)


def outside(row: tuple[str, str, str, str, str, str]) -> Iterator[tuple[float, float]]:
    """Values just outside of the bounds of a setting, with the bound."""
    least = 1 if row[1] == "int" else 1e-3
    for sign, text in re.findall(r"([<>]=?) ([^,]+)", row[3]):
        bound = float(text)
        step = 0 if sign in "<>" else least
        yield (bound + step if sign.startswith("<") else bound - step), bound


def with_planner(key: str) -> tuple[str, dict[str, object]]:
    """The key as it is set, and what must be set before it."""
    found = re.fullmatch(r"quality\.planner\[(\w+)\]\.(\w+)", key)
    return (f"quality.planner.{found[2]}", {"quality.planner.kind": found[1]}) if found else (key, {})


@each_bounded_row
def test_values_outside_of_their_bounds_are_refused_and_the_bound_is_named(
    number: int, row: tuple[str, str, str, str, str, str]
) -> None:
    """As a number in every second row, as text in the others."""
    key, before = with_planner(row[0])
    for value, bound in outside(row):
        whole = int(value) if row[1] == "int" else value
        with pytest.raises(ProfileError) as caught:
            profile_with(USUAL, {**before, key: str(whole) if number % 2 else whole})

        assert key in str(caught.value)
        assert bound in numbers(str(caught.value))


@each_bounded_row
def test_what_is_no_number_is_refused(number: int, row: tuple[str, str, str, str, str, str]) -> None:
    """One text in each row: how a number is read depends on its type only."""
    key, before = with_planner(row[0])
    value = ("nan", "inf", "-inf", "many", "", "1e999")[number % 6]
    with pytest.raises(ProfileError, match=re.escape(key)):
        profile_with(USUAL, {**before, key: value})


def test_no_type_of_number_is_read_from_what_is_none() -> None:
    for key in ("quality.perimeters", "quality.infill_density"):
        for value in ("nan", "inf", "-inf", "many", "", "1e999"):
            with pytest.raises(ProfileError, match=re.escape(key)):
                profile_with(USUAL, {key: value})


@given(
    st.dictionaries(
        st.sampled_from([row[0] for row in BOUNDED if "[" not in row[0]]),
        st.floats(min_value=-10, max_value=6000).map(lambda value: round(value, 2)),
        max_size=3,
    )
)
def test_changed_profiles_either_hold_the_new_values_or_are_refused(changes: dict[str, float]) -> None:
    profile = attempt(lambda: profile_with(USUAL, changes))
    if isinstance(profile, ProfileError):
        assert any(key in str(profile) for key in ROWS)
        return
    values = dict(list_settings(profile))

    assert {key: values[key] for key in changes} == changes
    assert {key: value for key, value in list_settings(USUAL) if key not in changes} == {
        key: value for key, value in values.items() if key not in changes
    }


def test_changing_nothing_changes_nothing() -> None:
    assert profile_with(USUAL, {}) == USUAL


def test_a_changed_profile_leaves_the_old_one_alone() -> None:
    before = dict(list_settings(USUAL))

    assert profile_with(USUAL, {"perimeters": 9}).quality.perimeters == 9
    assert dict(list_settings(USUAL)) == before


def test_a_setting_of_another_planner_is_refused() -> None:
    with pytest.raises(UsageError, match="tolerance"):
        profile_with(USUAL, {"quality.planner.kind": "uniform", "quality.planner.tolerance": 1})


# Settings against each other


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({"layer_height": 0.5}, ("quality.layer_height", "0.5", "0.32")),
        ({"layer_height": 0.203}, ("quality.layer_height", "0.203", "0.0025")),
        ({"first_layer_height": 0.04}, ("quality.first_layer_height", "0.04", "0.08")),
        ({"planner.kind": "area", "thinnest_layer": 0.3, "thickest_layer": 0.1}, ("thinnest", "0.3", "0.1")),
        ({"planner.kind": "area", "thickest_layer": 0.4}, ("thickest_layer", "0.4", "0.32")),
        ({"max_layer": 0.6, "layer_height": 0.6}, ("0.6", "0.4")),
        ({"min_layer": 0.3, "max_layer": 0.2}, ("printer.min_layer", "printer.max_layer")),
        ({"extrusion_width": 0.1}, ("quality.extrusion_width", "0.1")),
        ({"extrusion_width": 3}, ("quality.extrusion_width", "3", "0.4")),
        ({"nozzle_temperature": 400}, ("material.nozzle_temperature", "400", "260")),
        ({"bed_temperature": 150}, ("material.bed_temperature", "150", "110")),
    ],
)
def test_settings_that_contradict_each_other_are_named_with_their_values(
    changes: dict[str, object], names: tuple[str, ...]
) -> None:
    with pytest.raises(ProfileError) as caught:
        load_profile("marlin_220", "pla", "standard", changes)

    assert all(name in str(caught.value) for name in names)
    assert caught.value.remedy


def test_a_contradiction_names_the_file_the_setting_comes_from(write: Write) -> None:
    path = write("thick.toml", 'inherits = "standard"\nlayer_height = 0.5\n')

    assert path in refused("marlin_220", None, path)


@pytest.mark.parametrize("height", [0.1, 0.2, 0.3, 0.31, 0.08, 0.32])
def test_multiples_of_the_z_step_are_accepted_in_spite_of_rounding(height: float) -> None:
    assert profile_with(USUAL, {"layer_height": height}).quality.layer_height == height


def test_a_printer_without_a_heated_bed_takes_materials_that_ask_for_no_heat() -> None:
    cold = {"material.bed_temperature": 0, "material.first_layer_bed_temperature": 0}

    assert profile_with(USUAL, {"max_bed_temperature": 0, **cold}).printer.max_bed_temperature == 0


# The table of settings and their text


@pytest.mark.parametrize("row", ROWS.values(), ids=lambda row: row[0])
def test_every_setting_has_a_type_a_default_and_a_meaning(row: tuple[str, str, str, str, str, str]) -> None:
    key, kind, unit, bounds, default, meaning, *_ = row

    assert kind in {"float", "int", "bool", "str", "literal", "list"}
    assert meaning
    assert default or key.endswith("_gcode")
    assert bool(bounds) == (kind in {"float", "int", "literal"})
    assert bool(unit) == (kind in {"float", "list"}) or kind == "int" or key == "quality.overrides"


def test_the_table_lists_every_setting_that_a_profile_has() -> None:
    listed = {with_planner(key)[0] for key in ROWS}
    for names in (("marlin_220", "pla", "standard"), ("marlin_220", "pla", "adaptive")):
        assert {key for key, _ in list_settings(load_profile(*names))} - listed == set()


@pytest.mark.parametrize("key", ROWS)
def test_every_key_of_the_table_can_be_set(key: str) -> None:
    kind = re.search(r"\[(\w+)\]", key)
    profile = profile_with(USUAL, {"quality.planner.kind": kind[1]} if kind else {})
    name = with_planner(key)[0]

    assert profile_with(profile, {name: dict(list_settings(profile))[name]}) == profile


FITTING = [
    *product(PRINTERS, ["pla"], ["standard"]),
    *product(["voron_2_4_350"], MATERIALS, ["adaptive"]),
    *product(["marlin_220"], ["pla"], [name for name in QUALITIES if name != "case_study"]),
]


@pytest.mark.parametrize("names", FITTING, ids="-".join)
def test_all_settings_survive_being_written_as_text_and_read_back(names: tuple[str, str, str]) -> None:
    profile = load_profile(*names)
    text = {key: str(value) for key, value in list_settings(profile)}

    assert load_profile(changes=text) == profile


def test_settings_are_listed_once_and_in_the_order_of_printer_material_quality() -> None:
    keys = [key for key, _ in list_settings(USUAL)]

    assert len(set(keys)) == len(keys)
    assert [key.partition(".")[0] for key in keys] == sorted(
        (key.partition(".")[0] for key in keys), key=list(KINDS).index
    )


def test_profiles_cannot_be_changed_in_place() -> None:
    with pytest.raises(AttributeError):
        USUAL.quality.perimeters = 3  # type: ignore[misc]


def test_derived_widths_and_heights_follow_the_machine_unless_they_are_set() -> None:
    def of(**changes: object) -> Profile:
        return profile_with(USUAL, changes)

    assert of().extrusion_width == pytest.approx(1.125 * USUAL.printer.nozzle_diameter)
    assert of(extrusion_width=0.5).extrusion_width == 0.5
    assert (of().thinnest, of().thickest) == (USUAL.printer.min_layer, USUAL.printer.max_layer)
    assert (of(thinnest_layer=0.1).thinnest, of(thickest_layer=0.3).thickest) == (0.1, 0.3)


# The wheel


def test_a_built_wheel_holds_the_profiles_where_the_loader_looks(tmp_path: Path) -> None:
    wheels = pytest.importorskip("hatchling.builders.wheel")
    built = next(iter(wheels.WheelBuilder(str(ROOT)).build(directory=str(tmp_path), versions=["standard"])))
    names = set(zipfile.ZipFile(built).namelist())
    shipped = {path.relative_to(ROOT / "profiles") for path in (ROOT / "profiles").glob("*/*.*")}

    assert {f"printer_slicer/profiles/{path.as_posix()}" for path in shipped} <= names
    assert "printer_slicer/profiles/schema/printer.schema.json" in names
    assert "printer_slicer/cli/__init__.py" in names
    assert not [name for name in names if name.startswith(("tests/", "profiles/", "sample_parts/"))]


@pytest.mark.parametrize("inherits", ['inherits = "adaptive"\n', 'inherits = "standard"\n', ""])
def test_a_quality_with_a_layer_height_and_no_planner_means_uniform_layers(
    inherits: str, tmp_path: Path
) -> None:
    path = tmp_path / "own.toml"
    path.write_text(f'{inherits}name = "own"\nlayer_height = 0.15\n', encoding="utf-8")
    over = tmp_path / "over.toml"
    over.write_text(
        'inherits = "own.toml"\nname = "over"\nlayer_height = 0.1\n[planner]\nkind = "optimal"\n',
        encoding="utf-8",
    )

    assert type(load_profile(quality=str(path)).quality.planner).__name__ == "UniformPlanner"
    assert type(load_profile(quality=str(over)).quality.planner).__name__ == "OptimalPlanner"


@pytest.mark.parametrize(
    ("changes", "planner"),
    [
        ({"layer_height": 0.15}, "UniformPlanner"),
        ({"quality.layer_height": "0.15"}, "UniformPlanner"),
        ({"quality.layer_height": "0.15", "planner.kind": "optimal"}, "OptimalPlanner"),
        ({"perimeters": 3}, "OptimalPlanner"),
    ],
)
def test_a_layer_height_among_the_changes_means_uniform_layers(
    changes: dict[str, object], planner: str
) -> None:
    assert type(load_profile(changes=changes).quality.planner).__name__ == planner
