"""TOML texts made to exhaust the program that reads them, and the lines of faults."""

from __future__ import annotations

import re
import tomllib
import tracemalloc
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import ProfileError
from printer_slicer.profile import load_profile
from printer_slicer.profile.folders import find_profile_paths
from printer_slicer.profile.reading import KINDS, read_chain
from printer_slicer.toml_text import LARGEST, MAX_BYTES, MAX_PARTS, TomlError, find_key_lines, parse_toml

HOSTILE = {
    "a key of many parts": ("a = 1\n" + "a." * 20_000 + "b = 1\n", 2, "nested tables or lists"),
    "many such keys": ("".join(f"{'a.' * 60}b{n} = 1\n" for n in range(8000)), 1, "nested tables or lists"),
    "a table of many parts": ("\n\n[" + "a." * 20_000 + "b]\n", 3, "nested tables or lists"),
    "quoted parts": ("x = 1\n" + '"a".' * 9000 + "b = 1\n", 2, "nested tables or lists"),
    "parts in a table between braces": ("t = {" + "a . " * 9000 + "b = 1}\n", 1, "nested tables or lists"),
    "behind a comment of dots": (
        "# " + "a." * 90 + "\n" + "a." * 90 + "b = 1\n",
        2,
        "nested tables or lists",
    ),
    "behind a text of dots": (
        'x = """\n' + "a." * 90 + '"""\n' + "a." * 90 + "b = 1\n",
        3,
        "nested tables or lists",
    ),
    "lists in lists": ("a = 1\nb = " + "[" * 100_000, 2, "nested tables or lists"),
    "lists in lists, closed": ("a = 1\nb = " + "[" * 200 + "]" * 200, 2, "nested tables or lists"),
    "tables in tables": ("b = " + "{a=" * 100_000, 1, "nested tables or lists"),
    "few parsers go down so far": (
        "b = " + "[" * (MAX_PARTS + 1) + "]" * (MAX_PARTS + 1),
        1,
        "nested tables or lists",
    ),
    "a number of 5000 digits": ("a = 1\nb = " + "9" * 5000, 2, "an integer larger than"),
    "the same with underlines": ("a = 1\n\nb = " + "9_9" * 5000, 3, "an integer larger than"),
    "a hexadecimal one": ("a = 1\nb = 0x" + "f" * 5000, 2, "an integer larger than"),
    "one more than fits": (f"a = {LARGEST + 1}", 1, "an integer larger than"),
    "a text of 900 kB": ("a = 1\nb = '" + "x" * 900_000 + "'", 2, "a string of 900000 characters"),
    "a key of 900 kB": ("[t]\n" + "x" * 900_000 + " = 1", 1, "a key of 900000 characters"),
    "9 MB": ("b = '" + "x" * 9_000_000 + "'", 1, "over 1048576 characters"),
    "no value": ("a = 1\nb = \nc = 1\n", 2, "Invalid value"),
    "twice": ("a = 1\na = 2\n", 2, "Cannot overwrite"),
    "an open text": ("a = 1\nb = '''" + "'\n" * 1000, 1002, ""),
    "an open text of quotes": ('b = """' + '\\"' * 100_000, 1, ""),
    "nothing but signs": ("=", 1, ""),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_texts_are_refused_with_their_line(name: str) -> None:
    text, line, reason = HOSTILE[name]
    tracemalloc.start()
    try:
        with pytest.raises(TomlError) as caught:
            parse_toml(text)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert caught.value.line == line
    assert reason in caught.value.reason
    assert len(str(caught.value)) < 400
    assert peak < 40 * len(text) + 2**21


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_profile_is_an_error_with_file_and_remedy(name: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(HOSTILE[name][0], encoding="utf-8")

    with pytest.raises(ProfileError) as caught:
        load_profile(**{kind: str(path)})

    assert str(path) in str(caught.value)
    assert caught.value.remedy
    assert len(str(caught.value)) < 600


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="this system has no such device")
def test_a_device_is_no_profile(tmp_path: Path) -> None:
    (tmp_path / "endless.toml").symlink_to("/dev/zero")

    with pytest.raises(ProfileError, match=r"endless\.toml: is a pipe or a device"):
        load_profile(str(tmp_path / "endless.toml"))


@pytest.mark.parametrize("name", ["x" * 60_000, "é" * 150, "a/" + "x" * 300 + ".toml", "x/" * 30_000])
def test_names_that_no_file_can_have_are_refused(name: str, tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text(f'inherits = "{name}"\n', encoding="utf-8")

    for asked in (name, str(path)):
        with pytest.raises(ProfileError) as caught:
            load_profile(asked)
        assert len(str(caught.value)) < 600


def test_too_many_ancestors_are_refused(tmp_path: Path) -> None:
    for n in range(500):
        (tmp_path / f"p{n}.toml").write_text(f'inherits = "p{n + 1}.toml"\n')
    (tmp_path / "p500.toml").write_text("")

    with pytest.raises(ProfileError, match="more than 32 levels of inheritance"):
        load_profile(str(tmp_path / "p0.toml"))


@pytest.mark.parametrize("kind", KINDS)
def test_shipped_profiles_are_far_from_the_limits(kind: str) -> None:
    for name, path in find_profile_paths(kind).items():
        text = path.read_text(encoding="utf-8")
        assert parse_toml(text) == tomllib.loads(text)
        assert len(text) < MAX_BYTES / 10
        assert read_chain(kind, name).values


WORDS = st.sampled_from(
    [
        *(
            "a",
            "b.c",
            '"x.y"',
            "'d'",
            ".",
            " = ",
            "1",
            "1.5",
            "[",
            "]",
            "[[",
            "]]",
            "{",
            "}",
            ",",
            "\n",
            "\n[t]\n",
        ),
        *('"""', "'''", '"', "'", "\\", "# ", "true", "9" * 4400, "a." * 40, "[" * 40, "\r\n", "é"),
    ]
)


def parsed(text: str) -> dict[str, Any] | TomlError:
    try:
        return parse_toml(text)
    except TomlError as error:
        return error


@given(st.lists(WORDS, max_size=30).map("".join))
def test_what_is_within_the_limits_means_what_it_means_to_python(text: str) -> None:
    expected = None
    with suppress(ValueError, RecursionError):
        expected = tomllib.loads(text)
    found = parsed(text)
    n_lines = text.count("\n") + 1

    if isinstance(found, TomlError):
        assert 1 <= found.line <= n_lines
        assert expected is None or re.search("in each other|beyond|characters", found.reason)
    else:
        assert found == expected
        assert set(find_key_lines(text).values()) <= set(range(1, n_lines + 1))
