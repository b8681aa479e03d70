"""Extrusion that nothing holds: found, told, refused and allowed; bridges, overhangs and rafts are not."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import pytest

from printer_slicer.inspection.coverage.model_check import check_gcode
from printer_slicer.inspection.deposition.unsupported import (
    UnsupportedExtrusion,
    describe_unsupported,
    unsupported_of_program,
)
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile, profile_with
from printer_slicer.slice_jobs import job_of
from tests.cli.command_line import Outcome, typed
from tests.mesh_io.tiny_files import binary_stl
from tests.parts import box, cone, joined, sphere

PROFILE = profile_with(
    load_profile(), {"quality.planner.kind": "uniform", "quality.layer_height": 0.2, "quality.perimeters": 1}
)
STEM, PLATE = box((6, 6, 3)), box((30, 20, 1), at=(-12, -7, 3))
MUSHROOM = joined([STEM, PLATE], "mushroom")
TABLE = joined([box((6, 20, 3)), box((6, 20, 3), at=(16, 0, 0)), box((22, 20, 1), at=(0, 0, 3))], "table")
SPLINTER = joined([box((10, 10, 5)), box((8, 8, 2), at=(20, 0, 3))], "splinter")

SHELVES = joined([box((6, 6, 12)), box((30, 6, 1), at=(0, 0, 3)), box((6, 30, 1), at=(0, 0, 8))], "shelves")


def flared(n_steps: int = 20) -> Mesh:
    """Steps of 0.2 mm out and up: an overhang of 45°."""
    return joined(
        [box((10 + 0.4 * k, 10 + 0.4 * k, 0.2), at=(-0.2 * k, -0.2 * k, 0.2 * k)) for k in range(n_steps)],
        "flared",
    )


@cache
def sliced(part: Mesh) -> Job:
    return job_of(part, PROFILE)


def unsupported_of(job: Job) -> tuple[UnsupportedExtrusion, ...]:
    assert job.program is not None
    return unsupported_of_program(job.program, PROFILE)


@pytest.mark.parametrize("part", [MUSHROOM, SPLINTER], ids=lambda part: part.name)
def test_what_hangs_is_found_where_it_hangs(part: Mesh) -> None:
    found = unsupported_of(sliced(part))

    bottom = 3.0
    assert found[0].z == pytest.approx(bottom + 0.2, abs=0.01)
    assert found[0].layer == round(found[0].z / 0.2)
    assert len(found) == 1  # what lies on it rests, however badly
    assert found[0].length > 60


@pytest.mark.parametrize(
    ("part", "raft"),
    [
        (box((10, 10, 2)), 1.0),
        (TABLE, 0.0),
        (cone(6, 6), 1.0),
        (sphere(5), 0.0),
        (flared(), 0.0),
        *(pytest.param(part, 1.0, marks=pytest.mark.thorough) for part in (TABLE, sphere(5), flared())),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_bridges_overhangs_first_layers_and_rafts_are_held(part: Mesh, raft: float) -> None:
    profile = profile_with(PROFILE, {"quality.raft_height": raft})
    found = unsupported_of_program(slice_part(part, profile), profile)

    assert not found, describe_unsupported(found)


@pytest.mark.parametrize("part", [MUSHROOM, SPLINTER, TABLE, SHELVES], ids=lambda part: part.name)
def test_slice_print_check_and_dry_run_tell_the_same_length(part: Mesh) -> None:
    job = sliced(part)
    found = unsupported_of(job)
    by_rules = [one for one in job.findings if one.code == "unsupported"]
    by_model = [one for one in check_gcode(job.text, part).findings if one.code == "unsupported"]
    by_printer = [one for one in dry_run(job, PROFILE).faults if one.code == "unsupported"]

    assert bool(found) == bool(by_rules) == bool(by_model) == bool(by_printer) == (part is not TABLE)
    if not found:
        return
    first, length = found[0], sum(one.length for one in found)
    assert by_rules[0].is_error
    assert {one.layer for one in (by_rules[0], by_model[0], by_printer[0])} == {first.layer}
    assert by_rules[0].line == by_printer[0].line
    assert f"{length:.0f} mm" in by_rules[0].message
    assert f"{first.length:.0f} mm" in by_printer[0].message
    # Coordinates are rounded to 1 µm in the text; the program's are not.
    assert sum(one.amount or 0.0 for one in by_model) == pytest.approx(length, abs=0.5)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the part and its G-code."""
    path = tmp_path_factory.mktemp("unsupported")
    (path / "mushroom.stl").write_bytes(binary_stl(MUSHROOM.triangles))
    assert typed(*command("slice"), cwd=path).code == 0
    return path


def command(name: str, *more: object) -> tuple[object, ...]:
    """What is typed about the part."""
    return (name, "mushroom.stl", "--quality", "standard", "--set", "planner.kind=uniform", *more)


def test_slice_warns_and_strict_refuses(folder: Path) -> None:
    has_roles = typed(*command("slice", "-o", "told.gcode", "--json"), cwd=folder)
    refused = typed(*command("slice", "-o", "refused.gcode", "--strict"), cwd=folder)
    facts = json.loads(has_roles.out)

    assert has_roles.code == 0
    assert "warning:" in has_roles.err
    assert f"{facts['unsupported'][0]['length_mm']:.0f} mm of unsupported extrusion" in has_roles.err
    assert f"layer {facts['unsupported'][0]['layer']}, z " in has_roles.err
    assert any("unsupported extrusion" in one for one in facts["warnings"])
    assert refused.code == 3
    assert "mm of unsupported extrusion" in refused.err
    assert not (folder / "refused.gcode").exists()


def test_strict_takes_what_hangs_when_it_is_allowed_by_name(folder: Path) -> None:
    allowed = typed(
        *command("slice", "-o", "allowed.gcode", "--strict", "--allow", "unsupported"), cwd=folder
    )
    refused = typed(*command("slice", "-o", "refused.gcode", "--strict"), cwd=folder)

    assert ends(allowed) == (0, True)  # it is told all the same
    assert (folder / "allowed.gcode").read_bytes() == (folder / "mushroom.gcode").read_bytes()
    assert "--allow unsupported" in refused.err


def test_slice_allows_only_what_it_refuses(folder: Path) -> None:
    outcome = typed(*command("slice", "-o", "wrong.gcode", "--allow", "eeprom"), cwd=folder)

    assert outcome.code == 2
    assert "--allow: unknown: 'eeprom'; choose one of: unsupported" in outcome.err
    assert not (folder / "wrong.gcode").exists()


def ends(outcome: Outcome) -> tuple[int, bool]:
    """Exit code, and whether it speaks of what hangs."""
    return outcome.code, "unsupported extrusion" in outcome.out + outcome.err


@pytest.mark.parametrize("file", ["mushroom.stl", "mushroom.gcode"])
def test_print_refuses_it_until_it_is_allowed(folder: Path, file: str) -> None:
    port = ("--port", "sim:")

    assert ends(typed("print", file, *port, cwd=folder)) == (2, True)
    assert typed("print", file, *port, "--allow", "unsupported", cwd=folder).code == 0


def test_check_and_dry_run_fault_it(folder: Path) -> None:
    assert ends(typed("check", "mushroom.gcode", cwd=folder)) == (7, True)
    assert typed("check", "mushroom.gcode", "--allow", "unsupported", cwd=folder).code == 0
    assert typed("dry-run", "mushroom.gcode", cwd=folder).code == 7
    assert typed("dry-run", "mushroom.gcode", "--allow", "unsupported", cwd=folder).code == 0


def test_send_refuses_it_before_a_byte_is_sent(folder: Path) -> None:
    to = ("--to", "duet", "http://127.0.0.1:9")  # nobody listens: exit code 4

    assert ends(typed("send", "mushroom.gcode", *to, cwd=folder)) == (2, True)
    assert typed("send", "mushroom.gcode", *to, "--allow", "unsupported", cwd=folder).code == 4


def test_what_is_not_sent_is_said_to_be_so_with_what_helps(folder: Path) -> None:
    has_roles = typed("send", "mushroom.gcode", "--to", "duet", "http://127.0.0.1:9", cwd=folder).err

    assert "mushroom.gcode: not sent: line " in has_roles
    assert "Rotate the part or add supports. Use --allow unsupported to print it anyway" in has_roles
    assert "--printer" not in has_roles
