"""Contacts of the print head with the print: found where they are, and at no cost in prints by layers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer import sequential
from printer_slicer.inspection.deposition import head_contacts
from printer_slicer.inspection.deposition.head_contacts import HeadContactFinder
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.inspection.lint.scan import lint_text
from printer_slicer.profile.print_head import parse_head_shape
from tests.cli.command_line import typed
from tests.parts import box

PLATE = ps.join(
    [
        ps.Mesh(box((12, 12, height), at=(x, 60, 0)).triangles, name)
        for name, x, height in (("tall", 50, 20), ("low", 90, 5))
    ]
)


def load(head: str, order: str = "by_object") -> ps.Profile:
    changes = {"print_order": order, "printer.head": head, "layer_height": 0.3, "infill_density": 0}
    return ps.load_profile("marlin_220", quality="standard", changes=changes)


def slice_plate(head: str, order: str = "by_object") -> ps.Job:
    return ps.job_of(PLATE, load(head, order), placement=ps.Placement(as_placed=True))


@pytest.fixture(scope="module")
def job() -> ps.Job:
    return slice_plate("0: 20, 12: -999x-999 999x999")


@pytest.mark.parametrize(
    ("head", "contact"),
    [
        ("0: 25", ""),
        ("0: 32", "0 mm above the nozzle"),
        ("0: 5, 6: -999x-999 999x999", ""),
        ("0: 5, 3: -999x-999 999x999", "3 mm above the nozzle"),
        ("0: 5, 2: 1x-2 45x2", ""),
        ("0: 5, 2: -1x-2 45x2", ""),
        ("0: 5, 2: 1x-2 -45x2", ""),
    ],
)
def test_check_and_dry_run_report_the_shape_that_touches(job: ps.Job, head: str, contact: str) -> None:
    """The low part is printed first, 28 mm to the right of the tall one."""
    profile = load(head)
    found = [one for one in lint_text("plate.gcode", job.text, profile).findings if one.code == "head"]
    verdict = dry_run(job, profile)
    if "45x2" in head:
        contact = "2 mm above the nozzle" if "-45" not in head else ""
    if not contact:
        assert found == []
        assert verdict.problems == ()
        return
    assert contact in found[0].message
    assert found[0].is_error
    assert found[0].line > 0
    assert [contact in one for one in verdict.problems] == [True]


def test_a_wrong_order_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sequential, "find_print_order", lambda *_: (0, 1))
    wrong = slice_plate("0: 20, 12: -999x-999 999x999")

    (finding,) = [one for one in wrong.findings if one.code == "head"]
    assert "its shape 12 mm above the nozzle" in finding.message
    assert finding.times > 100
    assert "the head touches a printed part" in dry_run(wrong, load("12: -999x-999 999x999")).problems[0]


def test_check_ends_with_an_error(job: ps.Job, tmp_path: Path) -> None:
    path = tmp_path / "plate.gcode"
    path.write_bytes(job.text)
    for command in ("check", "dry-run"):
        for head, code in (("0: 20", 0), ("0: 60", 7)):
            outcome = typed(command, path, "--printer", "marlin_220", "--set", f"printer.head={head}")
            assert outcome.code == code
            assert ("the head touches" in outcome.out + outcome.err) is bool(code)


def test_a_print_by_layers_makes_no_map(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("a map was made")

    monkeypatch.setattr(head_contacts, "_make_range_maxima", fail)
    profile = load("0: 5", "by_layer")
    assert dry_run(ps.job_of(PLATE, profile), profile).problems == ()


def test_contacts_may_be_allowed(job: ps.Job) -> None:
    verdict = dry_run(job.allowing(["head"]), load("0: 60"))
    assert verdict.problems == ()
    assert any("the head touches" in note for note in verdict.notes)


@pytest.mark.parametrize("seed", range(5))
def test_dilated_maps_are_those_of_a_direct_search(seed: int) -> None:
    random = np.random.default_rng(seed)
    corners = random.uniform(-12, 12, (5, 2)).round(1)
    shape = parse_head_shape("0: " + " ".join(f"{x:g}x{y:g}" for x, y in corners))
    finder = HeadContactFinder([shape], ((0.0, 0.0), (20.0, 15.0)))
    heights = np.where(random.random((30, 40)) < 0.05, random.uniform(1, 30, (30, 40)), 0.0)
    made = finder._dilate(heights, head_contacts._make_range_maxima(heights), shape)

    polygon = np.array(shape.corners)
    along = np.roll(polygon, -1, axis=0) - polygon
    length = np.hypot(*along.T)
    rows, columns = np.nonzero(heights)
    for row in range(0, 30, 3):
        for column in range(0, 40, 3):
            offset = np.stack([(columns - column) * 0.5, (rows - row) * 0.5], axis=1)
            to = offset[:, None] - polygon
            room = (along[:, 0] * to[:, :, 1] - along[:, 1] * to[:, :, 0]) / length
            within = (room >= 1.0 - 1e-9).all(axis=1)
            expected = heights[rows[within], columns[within]].max(initial=0.0)
            sure = (room >= 1.0 + 1e-6).all(axis=1)
            assert made[row, column] in {expected, heights[rows[sure], columns[sure]].max(initial=0.0)}
