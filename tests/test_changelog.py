"""Fragments become a section of the changelog, and all fragments are sound."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.changelog import ROOT, main, section, with_section
from printer_slicer.version import VERSION

MAX_WORDS = 800  # of a section
ONE = "### Added\n- a flag\n  of two lines\n- another\n\n### Fixed\n- a fault\n"
OTHER = "### Fixed\n- a second fault\n### Removed\n- a format\n"


def test_entries_of_all_fragments_stand_under_one_heading_for_each_kind() -> None:
    text = section("9.9.9", {"one.md": ONE, "other.md": OTHER})

    assert text.startswith("## 9.9.9 (")
    assert text.count("### Fixed") == 1
    assert text.partition("### Fixed\n\n")[2].startswith("- a fault\n- a second fault\n\n### Removed")
    assert "- a flag\n  of two lines\n- another\n" in text


@pytest.mark.parametrize(
    "wrong",
    ["", "- a line\n", "### Other\n- a line\n", "### Added\n", "### Added\nno list\n", "x\n### Added\n- y\n"],
)
def test_a_fragment_that_is_no_list_of_a_known_kind_is_named(wrong: str) -> None:
    with pytest.raises(ValueError, match=r"wrong\.md"):
        section("9.9.9", {"wrong.md": wrong})


def test_a_release_moves_the_fragments_into_the_changelog(tmp_path: Path) -> None:
    (tmp_path / "changelog.d").mkdir()
    (tmp_path / "changelog.d" / "one.md").write_text(ONE)
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\nHead.\n\n## 0.0.1\n\n- old\n")

    assert main([VERSION, "--draft"], tmp_path) == 0
    assert (tmp_path / "changelog.d" / "one.md").exists()
    assert main([VERSION], tmp_path) == 0

    lines = (tmp_path / "CHANGELOG.md").read_text().splitlines()
    assert [line.split()[1] for line in lines if line.startswith("## ")] == [VERSION, "0.0.1"]
    assert lines[-1] == "- old"
    assert "- a fault" in lines
    assert not list((tmp_path / "changelog.d").iterdir())


def test_a_version_that_is_not_this_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit):
        main(["0.0.0"], tmp_path)


def test_a_version_is_written_once() -> None:
    with pytest.raises(ValueError, match="already"):
        with_section("# Changelog\n\n## 1.0.0 (2020-01-01)\n\n- x\n", section("1.0.0", {"one.md": ONE}))


def test_every_fragment_of_this_project_is_sound() -> None:
    fragments = {path.name: path.read_text(encoding="utf-8") for path in ROOT.glob("changelog.d/*.md")}

    assert not fragments or len(section(VERSION, fragments).split()) <= MAX_WORDS


def test_every_place_that_tells_the_version_tells_the_same() -> None:
    for file, line in (("pyproject.toml", f'version = "{VERSION}"'), ("CITATION.cff", f"version: {VERSION}")):
        assert line in (ROOT / file).read_text(encoding="utf-8").splitlines(), file
