"""Former names of settings work for one release, wherever settings are written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from printer_slicer.profile import load_profile, profile_with, settings_as_dict
from printer_slicer.profile.files import restore_profile
from printer_slicer.profile.keys import list_section_keys
from printer_slicer.profile.renamed import RENAMED, find_current_name, replace_former_names


@contextmanager
def names_the_new_name(*names: str) -> Iterator[None]:
    """Expect a warning for each present name."""
    with pytest.warns(FutureWarning) as seen:
        yield
    texts = [str(one.message) for one in seen]
    assert len(texts) == len(names), texts
    assert all(any(f"now called {name};" in text for text in texts) for name in names), texts


def test_every_present_name_is_a_setting_and_no_former_one_is() -> None:
    known = {key for kind in ("printer", "quality") for key in list_section_keys(kind, {})}

    assert set(RENAMED.values()) <= known
    assert not set(RENAMED) & known


@pytest.mark.parametrize("old", [*RENAMED])
def test_a_change_by_its_former_name(old: str) -> None:
    value = True if old == "outer_perimeter_first" else 0.3
    with pytest.warns(FutureWarning, match=RENAMED[old]):
        by_old_name = load_profile(changes={f"quality.{old}": value})

    assert by_old_name == load_profile(changes={f"quality.{RENAMED[old]}": value})
    assert by_old_name != load_profile()


def test_a_file_with_former_names(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(
        'name = "own"\nsparse_overlap = 0.3\n[speeds]\ntop_skin = 33\n'
        '[[overrides]]\nobject = "box"\nset = { "speeds.sparse" = 22 }\n'
    )
    with names_the_new_name("internal_infill_overlap", "speeds.top_solid_infill", "speeds.internal_infill"):
        quality = load_profile(quality=str(file)).quality

    assert (quality.internal_infill_overlap, quality.speeds.top_solid_infill) == (0.3, 33)
    assert dict(quality.overrides[0].set) == {"speeds.internal_infill": 22}


def test_a_warning_names_file_and_line(tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text('name = "own"\n\n[speeds]\nsparse = 33\n')
    with pytest.warns(FutureWarning, match=rf"{file}:4: speeds\.sparse is now called"):
        load_profile(quality=str(file))


def test_a_child_with_a_former_name_wins_over_its_parent(tmp_path: Path) -> None:
    (tmp_path / "parent.toml").write_text('name = "parent"\ninternal_infill_every = 0.4\n')
    child = tmp_path / "child.toml"
    child.write_text('name = "child"\ninherits = "parent.toml"\nsparse_every = 0.6\n')
    with names_the_new_name("internal_infill_every"):
        quality = load_profile(quality=str(child)).quality

    assert quality.internal_infill_every == 0.6


def test_overrides_as_they_are_typed() -> None:
    with names_the_new_name("speeds.gap_fill"):
        profile = profile_with(load_profile(), {"overrides": "lid:speeds.gap=20"})

    assert dict(profile.quality.overrides[0].set) == {"speeds.gap_fill": "20"}


def test_settings_that_an_older_version_kept() -> None:
    """What a journal or G-code of an older version holds is read without a warning: nobody typed it."""
    profile = load_profile(changes={"quality.speeds.internal_infill": 41})
    kept = settings_as_dict(profile)
    former = {new: old for old, new in RENAMED.items()}
    kept["quality"]["speeds"] = {
        former.get(f"speeds.{key}", f"speeds.{key}").removeprefix("speeds."): value
        for key, value in msgspec.to_builtins(profile.quality.speeds).items()
    }

    assert "sparse" in kept["quality"]["speeds"]
    assert restore_profile(kept) == profile


def test_a_present_name_wins_over_a_former_one() -> None:
    assert replace_former_names({"sparse_every": 1, "internal_infill_every": 2}) == {
        "internal_infill_every": 2
    }
    assert find_current_name("quality.speeds.gap") == "quality.speeds.gap_fill"
    assert find_current_name("speeds.travel") == "speeds.travel"


@pytest.mark.parametrize(("typed", "value"), [("20%", 0.2), ("100%", 1.0), ("12.5%", 0.125), ("0.2", 0.2)])
def test_percentages_of_shares(typed: str, value: float) -> None:
    assert load_profile(changes={"infill_density": typed}).quality.infill_density == value


def test_percentages_in_a_file_and_in_its_overrides(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'name = "mine"\ninherits = "standard"\ninfill_density = "20%"\n'
        'overrides = [{object = "lid", set = {infill_density = "40%"}}]\n'
    )

    quality = load_profile(quality=str(path)).quality

    assert quality.infill_density == 0.2
    assert [dict(one.set) for one in quality.overrides] == [{"infill_density": "0.4"}]


def test_a_percentage_of_a_length_is_refused() -> None:
    with pytest.raises(Exception, match=r"extrusion_width=110%: .*expected a number"):
        load_profile(changes={"extrusion_width": "110%"})
