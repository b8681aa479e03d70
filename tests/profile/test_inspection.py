"""Where values come from, how profiles differ, everything that is wrong at once, and what a new file holds."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.profile import KINDS, find_profile_paths
from printer_slicer.profile.inspection import (
    DEFAULT,
    compare_settings,
    find_faults,
    find_setting_origins,
    read_headline,
)
from printer_slicer.profile.keys import find_nearest_key, list_section_keys
from printer_slicer.profile.reading import SettingsSource, read_chain
from printer_slicer.profile.template import format_new_profile, format_toml_value
from printer_slicer.toml_text import find_key_lines

PARENTS = {"printer": "prusa_mk3s", "material": "petg", "quality": "fine"}


def written(folder: Path, text: str, name: str = "mine.toml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


# Where values come from


def test_every_value_tells_file_and_line_or_that_it_is_a_default(tmp_path: Path) -> None:
    path = written(tmp_path, 'inherits = "fine"\n\n[speeds]\n# slow\ntravel = 80\n')
    told = find_setting_origins("quality", read_chain("quality", path))
    fine = find_profile_paths("quality")["fine"]

    assert told["speeds.travel"] == (80, f"{path}:5")
    assert told["layer_height"].place.startswith(f"{fine}:")
    assert (
        fine.read_text().splitlines()[int(told["layer_height"].place.rpartition(":")[2]) - 1]
        == "layer_height = 0.12"
    )
    assert told["perimeters"].place.startswith(str(find_profile_paths("quality")["standard"]))
    assert told["ironing"] == (False, DEFAULT)


@pytest.mark.parametrize("name", find_profile_paths("printer"))
def test_the_line_told_is_the_one_that_sets_the_key(name: str) -> None:
    for key, (_, place) in find_setting_origins("printer", read_chain("printer", name)).items():
        if place != DEFAULT:
            file, _, line = place.rpartition(":")
            assert (
                Path(file)
                .read_text(encoding="utf-8")
                .splitlines()[int(line) - 1]
                .startswith(f"{key.rpartition('.')[2]} = ")
            )


def test_profiles_differ_in_what_one_of_them_says() -> None:
    chains = (read_chain("quality", name) for name in ("standard", "fine"))

    assert compare_settings("quality", *chains) == {
        "name": ("standard", "fine"),
        "layer_height": (0.2, 0.12),
        "resolution": (0.0125, 0.008),
        "speeds.ratio": (1, 0.8),
        "speeds.visible_most": (0, 80),
    }


def test_what_only_one_of_two_planners_has_is_a_difference() -> None:
    chains = [read_chain("quality", name) for name in ("standard", "adaptive")]

    assert compare_settings("quality", *chains)["planner.error_price_ratio"] == (None, 45)
    assert compare_settings("quality", chains[0], chains[0]) == {}


# Everything that is wrong


def test_all_faults_of_a_file_are_told_with_their_lines(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        'inherits = "standard"\nperimetres = 3\ninfill_density = 2\n\n[speeds]\ntravel = "fast"\ntravl = 3\n\n'
        '[planner]\nkind = "cosp"\n',
    )
    faults = find_faults("quality", path)

    assert sorted(fault.place for fault in faults) == [f"{path}:{line}" for line in (10, 2, 3, 6, 7)]
    assert {fault.path for fault in faults} == {
        "perimetres",
        "infill_density",
        "speeds.travel",
        "speeds.travl",
        "planner.kind",
    }
    assert all(fault.remedy for fault in faults)


OWN = """inherits = "standard"
name = "ov"
planner = {kind = "optimal", ranges = [{low = "a", high = 3}, {high = 4}]}
[[overrides]]
set = {perimeters = 400}
[[overrides]]
object = "lid"
set = {seam = "rear", perimters = 3}
[[overrides]]
low = 10
high = 5
set = {perimeters = "x"}
[[overrides]]
hihg = 3
set = 3
[[overrides]]
object = "can"
[overrides.set]
perimeters = [3]
"quality.infill" = "gridd"
"""


def test_all_faults_of_objects_and_heights_are_told_with_their_lines(tmp_path: Path) -> None:
    path = written(tmp_path, OWN)
    faults = {
        (int(fault.place.rpartition(":")[2]), fault.path): (fault.problem, fault.remedy)
        for fault in find_faults("quality", path)
    }

    assert set(faults) == {
        (3, "planner.ranges[0].low"),
        (3, "planner.ranges[1].low"),
        (4, "overrides[0]"),
        (5, "overrides[0].set.perimeters"),
        (8, "overrides[1].set.seam"),
        (8, "overrides[1].set.perimters"),
        (11, "overrides[2].high"),
        (12, "overrides[2].set.perimeters"),
        (14, "overrides[3].hihg"),
        (15, "overrides[3].set"),
        (19, "overrides[4].set.perimeters"),
        (20, "overrides[4].set.quality.infill"),
    }
    assert faults[14, "overrides[3].hihg"][1] == "Did you mean 'high'?"
    assert "Did you mean 'grid'?" in faults[20, "overrides[4].set.quality.infill"][1]


def test_each_line_of_the_chain_is_told_of_what_adds_up(tmp_path: Path) -> None:
    parent = written(
        tmp_path, 'inherits = "standard"\n[[overrides]]\nlow = 3\nset = {perimeters = 101}\n', "parent.toml"
    )
    child = written(
        tmp_path, f'inherits = "{parent}"\n\n\n\n[[overrides]]\nlow = 3\nset = {{ ironing = 2 }}\n'
    )

    assert [fault.place for fault in find_faults("quality", child)] == [f"{parent}:4", f"{child}:7"]


def test_ranges_that_contradict_each_other_are_told(tmp_path: Path) -> None:
    text = 'inherits = "adaptive"\n[planner]\nkind = "optimal"\nranges = "3:1:tolerance=0.1"\n'

    assert [fault.place[-2:] for fault in find_faults("quality", written(tmp_path, text))] == [":4"]


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("speeds.external", "speeds.external_perimeter"),
        ("perimters", "perimeters"),
        ("quality.perimters", "quality.perimeters"),
        ("travel", "speeds.travel"),
        ("sppeds.travel", "speeds.travel"),
        ("inherits", ""),
        ("foo", ""),
    ],
)
def test_only_names_that_are_near_are_offered(key: str, near: str) -> None:
    known = [f"{kind}.{one}" for kind in KINDS for one in list_section_keys(kind, {})]

    assert find_nearest_key(key, [*known, *(one.partition(".")[2] for one in known)]) == near


@pytest.mark.parametrize(
    ("kind", "text", "problem", "remedy"),
    [
        ("quality", 'infill = "gridd"', "quality.infill: unknown value 'gridd'", "Did you mean 'grid'?"),
        (
            "printer",
            'thumbnails = ["0x0"]',
            "expected text such as 32x32, 300x300/QOI; got '0x0'",
            "lists types",
        ),
        ("printer", "bed_x = 1979-05-27", "printer.bed_x: expected a number; got 1979-05-27", "lists types"),
        ("printer", "probe = 7", "printer.probe: expected true or false; got 7", "lists types"),
        (
            "quality",
            'overrides = "lid"',
            "'lid' is not a valid list",
            'overrides = "lid:infill_density=0.4',
        ),
        ("quality", 'planner = "cusp"', "expected a table; got 'cusp'", "planner = { kind"),
    ],
)
def test_messages_are_in_words_of_people(
    tmp_path: Path, kind: str, text: str, problem: str, remedy: str
) -> None:
    parent = {"printer": "marlin_220", "quality": "standard"}[kind]
    (fault,) = find_faults(kind, written(tmp_path, f'inherits = "{parent}"\n{text}\n'))

    assert problem in fault.problem
    assert remedy in fault.remedy


def test_what_is_missing_is_told_beside_what_is_wrong(tmp_path: Path) -> None:
    faults = find_faults("printer", written(tmp_path, 'bed_x = 200\nflavour = "grbl"\n'))

    assert {fault.path for fault in faults} == {"name", "bed_y", "bed_z", "flavour"}


def test_a_fault_of_the_parent_is_told_in_its_file(tmp_path: Path) -> None:
    parent = written(tmp_path, 'inherits = "pla"\ndensity = -1\n', "parent.toml")
    child = written(tmp_path, f'inherits = "{parent}"\nfan_ratio = 3\n')

    assert sorted(fault.place for fault in find_faults("material", child)) == [f"{child}:2", f"{parent}:2"]


def test_a_printer_that_contradicts_itself_is_told(tmp_path: Path) -> None:
    path = written(
        tmp_path, 'inherits = "marlin_220"\nmin_layer = 0.3\nmax_layer = 0.2\nz_full_step = 0.0033\n'
    )

    assert [fault.path for fault in find_faults("printer", path)] == ["min_layer", "z_full_step"]


def test_a_key_of_another_kind_is_told_where_it_belongs(tmp_path: Path) -> None:
    (fault,) = find_faults("material", written(tmp_path, 'inherits = "pla"\nbed_x = 200\n'))

    assert fault.remedy == "Move it to a printer profile"


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_wrong_with_what_is_shipped(kind: str) -> None:
    assert {name: find_faults(kind, name) for name in find_profile_paths(kind)} == {
        name: [] for name in find_profile_paths(kind)
    }


# New files


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_profile_changes_nothing_but_the_name(tmp_path: Path, kind: str) -> None:
    parent = read_chain(kind, PARENTS[kind])
    path = written(tmp_path, format_new_profile(kind, "mine", PARENTS[kind], parent, "#:schema x"))

    assert set(compare_settings(kind, parent, read_chain(kind, path))) == {"name"}
    assert find_faults(kind, path) == []


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_profile_lists_all_that_may_be_changed_as_it_is_now(tmp_path: Path, kind: str) -> None:
    parent = read_chain(kind, PARENTS[kind])
    text = format_new_profile(kind, "mine", PARENTS[kind], parent, "#:schema x")
    listed = text.partition("shows the changes.\n")[2]
    bare = re.sub(r"(?m)^# (?!.*\.\.\.)", "", listed)
    # Meanings go, settings stay: these have a sign of equality behind their key, or go over several lines.
    settings, inside = [], False
    for line in bare.splitlines():
        if inside or re.match(r"\w+ = |\[\w+\]$", line):
            settings.append(line.partition(" # other kinds")[0] if line.startswith("kind") else line)
            inside = (not inside and line.endswith('"""') and line.count('"""') == 1) or (
                inside and line != '"""'
            )
    values = tomllib.loads("\n".join(settings))
    told = find_setting_origins(kind, SettingsSource({**values, "name": "mine"}, {}, "new"))
    was = find_setting_origins(kind, parent)

    assert {key: one.value for key, one in told.items() if key != "name"} == {
        key: one.value for key, one in was.items() if key != "name"
    }


@given(
    st.recursive(
        st.text()
        | st.booleans()
        | st.integers(-(2**53), 2**53)
        | st.floats(-1e9, 1e9).map(lambda x: round(x, 4)),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
        max_leaves=5,
    )
)
def test_a_value_written_as_toml_is_read_back(value: object) -> None:
    assert tomllib.loads(f"key = {format_toml_value(value)}")["key"] == value


# Lines and headlines


def test_lines_of_keys_are_found_through_texts_lists_and_tables() -> None:
    text = (
        'a = """\nb = 1\n[no.table]\n"""\n# c = 3\nlist = [\n  1, # d = 4\n  "]", \n]\n"quoted key" = 2\n'
        'x.y = 3 # z = 4\n[table . inner]\n\'e\' = """x\\""""\n[[many]]\nf = { g = 1 }\n[[many]]\nf = 2\n'
    )

    assert tomllib.loads(text)
    assert find_key_lines(text) == {
        "a": 1,
        "list": 6,
        "quoted key": 10,
        "x.y": 11,
        "table.inner": 12,
        "table.inner.e": 13,
        "many": 14,
        "many[0]": 14,
        "many[0].f": 15,
        "many[1]": 16,
        "many[1].f": 17,
    }
    nested = find_key_lines("[[a]]\n[a.b]\nc = 1\n[[a]]\n[[a.d]]\ne = 1\n[[a.d]]\ne = 2\n")
    assert (nested["a[0].b.c"], nested["a[1].d[0].e"], nested["a[1].d[1].e"]) == (3, 6, 8)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("#:schema x\n# One of 2.4 mm. More.\n", "One of 2.4 mm"),
        ("# All of it\nname = 1", "All of it"),
        ("name = 1\n# too late", ""),
        ("", ""),
    ],
)
def test_the_headline_is_the_first_sentence_of_the_first_comment(
    tmp_path: Path, text: str, told: str
) -> None:
    assert read_headline(Path(written(tmp_path, text))) == told
