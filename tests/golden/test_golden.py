"""A small file, byte for byte."""

from __future__ import annotations

from difflib import unified_diff

from tests.golden.make import FILE, made


def test_the_golden_file_is_what_is_made_now() -> None:
    was, now = FILE.read_bytes(), made()
    before, after = (text.decode("ascii").splitlines() for text in (was, now))
    changes = "\n".join(unified_diff(before, after, n=1, lineterm=""))

    assert now == was, (
        f"to accept this, run `python -m tests.golden.make` and look at `git diff`:\n{changes[:4000]}"
    )


def test_the_golden_file_shows_what_there_is_to_see() -> None:
    """It is short enough to be read, and holds every kind of line that a box can have."""
    text = FILE.read_text("ascii")

    assert text.count(";LAYER_CHANGE\n") == 3
    assert len(text.splitlines()) < 750
    for kind in (
        "Skirt/Brim",
        "Perimeter",
        "External perimeter",
        "Solid infill",
        "Internal infill",
        "Top solid infill",
    ):
        assert f";TYPE:{kind}\n" in text
    assert all(word in text for word in ("M106 S", "M104 S200", "M109 S210", "G1 E-0.8", "G92 E0"))
