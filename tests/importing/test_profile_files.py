"""Files of imported profiles: names and contents."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.importing import (
    ConvertedSetting,
    ImportedProfile,
    choose_file_names,
    format_profile,
    make_short_name,
)

TEXTS = st.text(max_size=60)
VALUES = (
    st.booleans() | st.integers(-(10**6), 10**6) | st.floats(-1e6, 1e6) | TEXTS | st.lists(TEXTS, max_size=3)
)
TABLES = st.dictionaries(
    st.from_regex(r"[a-z]{1,8}", fullmatch=True), VALUES | st.fixed_dictionaries({"kind": TEXTS}), max_size=8
)


def made(values: dict[str, Any], name: str = "A", kind: str = "printer") -> ImportedProfile:
    return ImportedProfile(
        kind,
        name,
        "/some/file.ini:3",
        values,
        tuple(ConvertedSetting("x", "y", key, 0, "a\nhow") for key in values),
    )


def plain(value: Any) -> Any:
    """Return a value as it is in a file: texts of several lines end with one newline."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    return value.strip("\n") + "\n" if isinstance(value, str) and "\n" in value else value


@given(TABLES)
def test_a_file_has_the_values_of_its_profile(values: dict[str, Any]) -> None:
    assert tomllib.loads(format_profile(made(values, "any \x00 name"))) == plain(values)


@given(st.lists(st.tuples(st.sampled_from(["printer", "material"]), TEXTS), max_size=8))
def test_file_names_are_unique_and_valid_on_every_system(names: list[tuple[str, str]]) -> None:
    found = choose_file_names([made({}, name, kind) for kind, name in names])

    assert len({(kind, one) for (kind, _), one in zip(names, found, strict=True)}) == len(names)
    assert all(one and set(one) <= set("abcdefghijklmnopqrstuvwxyz0123456789_") for one in found)


def test_file_names_are_easy_to_type() -> None:
    names = [
        "Creality Ender-3 V2 (0.4 mm nozzle)",
        "MK3S & MK3S+",
        "MK3S & MK3S+",
        "Überdrucker",
        "con",
        "..",
        "日本",
    ]

    assert choose_file_names([made({}, name) for name in names]) == [
        "creality_ender_3_v2", "mk3s_mk3s_plus", "mk3s_mk3s_plus_2", "uberdrucker", "con_", "printer", "printer_2",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "short"),
    [
        ("0.20mm QUALITY @CREALITY", "0_20mm_quality"),
        ("Creality Ender-3 V2 (0.6 mm nozzle)", "creality_ender_3_v2_0_6_mm"),
        ("/home/me/Slicer Profiles/My Printer.ini", "my_printer"),
        ("C:\\Users\\me\\printer.json", "printer"),
        ("Generic PLA @System", "generic_pla"),
        (
            "Original Prusa i3 MK3S & MK3S+ with a very long name of sixty letters",
            "original_prusa_i3_mk3s_mk3s_plus",
        ),
        ("@home", "home"),
        ("x" * 90, "x" * 32),
    ],
)
def test_names_of_files_are_short_and_never_paths(name: str, short: str) -> None:
    assert make_short_name(name) == short
    assert choose_file_names([made({}, name)]) == [short]


def test_a_name_that_is_taken_gets_longer_before_it_gets_a_number() -> None:
    qualities = [made({}, f"0.2 mm Fine @{vendor}", "quality") for vendor in ("A", "B")]

    assert choose_file_names(qualities) == ["0_2_mm_fine", "0_2_mm_fine_b"]
    assert choose_file_names(qualities[:1], lambda _kind, name, _own: "a" not in name) == ["0_2_mm_fine_a"]
