"""Slips of who types: what is near is offered, what is expected is told, and what makes no sense is not passed over."""

from __future__ import annotations

import pytest
from command_line import BOX, is_message, typed


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("slice --prnter x part.stl", "slice: --prnter: no such flag\n  did you mean '--printer'?"),
        ("slice part.stl --prnter=x", "slice: --prnter: no such flag\n  did you mean '--printer'?"),
        ("slcie", "COMMAND: there is no 'slcie'; did you mean 'slice'? choose one of: slice, plan"),
        ("profiles lst", "profiles: WHAT: there is no 'lst'; did you mean 'list'?"),
        ("slice part.stl --units mmm", "slice: --units: there is no 'mmm'; did you mean 'mm'?"),
        ("check --link abc x", "check: --link: 'abc': expected a whole number over 0"),
        ("contours x.stl -o x.svg --smooth x", "contours: --smooth: 'x': expected a number, such as 0.02"),
        ("slice part.stl --layer 1.5", "slice: --layer: '1.5': expected a whole number"),
        ("draw x.gcode -o x.svg --z up", "draw: --z: 'up': expected a height over the bed"),
        ("slice part.stl --printer", "slice: --printer: a value belongs behind it"),
        ("ports x", "ports: x: nothing is expected there"),
        ("profiles import x --foldr y", "profiles import: --foldr: no such flag\n  did you mean '--folder'?"),
    ],
)
def test_what_cannot_be_read_is_told_with_what_is_near(line: str, told: str) -> None:
    outcome = typed(*line.split())

    assert outcome.code == 2
    assert is_message(outcome, told, "--help tells all")


def test_a_height_under_the_bed_is_refused_as_a_height() -> None:
    outcome = typed("slice", BOX, "-o", "-", "--range", "-5:5:perimeters=4")

    assert outcome.code == 2
    assert is_message(outcome, "--range -5:5:perimeters=4", "it is -5")
