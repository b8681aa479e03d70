"""Several things on a plate: each can be given up, and the others are printed as if nothing had happened."""

from __future__ import annotations

import re
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.arrays import Float, Int
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.placing import join, transform
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.slice_jobs import job_from, job_of
from printer_slicer.stages import Stages
from tests.effort import crossed
from tests.mesh_io.tiny_files import item, mesh_xml, model_xml, three_mf, write
from tests.parts import box, box_with_hole, cone, plain, profile
from tests.tiny_gcode import commands

KINDS = ["octoprint", "m486", "exclude_object"]
NAMES = ("cube", "cone", "post")


def named(mesh: Mesh, name: str, at: tuple[float, float, float]) -> Mesh:
    moved = mesh.moved(at)
    return Mesh(moved.triangles, name)


def plate() -> Mesh:
    cube, post = box((10, 10, 2)), box((4, 4, 3))
    return join(
        [
            named(cube, "cube", (0, 0, 0)),
            named(cone(5, 3), "cone", (25, 5, 0)),
            named(post, "post", (5, 25, 0)),
        ]
    )


def wanted(**changes: object) -> Profile:
    return plain(**{"thumbnails": "", "skirt_loops": 2, "brim_width": 1, "z_hop": 0.3, **changes})


OF_TEXT = {"labels", "printer.labels", "relative_extrusion", "start_gcode"}
"""Settings that only decide how a program is written."""


@cache
def sliced_once(**changes: object) -> Stages:
    return slice_stages(plate(), wanted(**changes))


def sliced(**changes: object) -> Stages:
    return sliced_once(**{key: value for key, value in changes.items() if key not in OF_TEXT})


def text_of(**changes: object) -> list[str]:
    stages = sliced(**changes)
    return gcode_of(stages.program, wanted(**changes), labels=stages.labels).decode().splitlines()


STARTS = re.compile(r"(?:; printing object |EXCLUDE_OBJECT_START NAME=)([\w-]+)|M486 S(\d+)")
STOPS = re.compile(r"; stop printing object |EXCLUDE_OBJECT_END |M486 S-1")


def marked(lines: list[str]) -> list[str]:
    """The thing that each line belongs to, "" for none."""
    now, found = "", []
    for line in lines:
        if STOPS.match(line):
            now = ""
        elif start := STARTS.match(line):
            assert not now
            now = start[1] or NAMES[int(start[2])]
        found.append(now)
    assert not now
    return found


def beads(lines: list[str]) -> tuple[Float, Int]:
    """From where to where each bead lies, how much is in it, what the nozzle lacks before it; and its command."""
    moves = read_moves([line.encode() for line in lines])
    lays = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    pulled = np.cumsum(np.where(lays, 0.0, moves.delta[:, 3]))[:, None]
    ways = np.hstack([moves.end - moves.delta[:, :3], moves.end, moves.delta[:, 3:], pulled])
    return ways[lays], moves.line[lays]


def commands_of(lines: list[str]) -> list[str]:
    return [line for line in lines if line and not line.startswith(";")]


@pytest.mark.parametrize(("how", "given_up"), crossed(list(product(KINDS, [True, False])), NAMES))
def test_a_thing_given_up_leaves_the_others_as_they_are(how: tuple[str, bool], given_up: str) -> None:
    """The printer passes over the moves between the marks, as Marlin does; all other commands it obeys."""
    kind, relative = how
    lines = text_of(labels=kind, relative_extrusion=relative)
    owner = marked(lines)
    both = list(zip(lines, owner, strict=True))
    rest = [line for line, name in both if name != given_up or not re.match("G[01] ", line)]
    of_command = np.array([name for line, name in both if commands_of([line])])
    (every, command), (left, _) = beads(commands_of(lines)), beads(commands_of(rest))
    others = of_command[command] != given_up

    assert 20 < (~others).sum() < len(others) - 20
    assert left == pytest.approx(every[others], abs=2e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_every_bead_lies_in_the_thing_it_is_marked_as(kind: str) -> None:
    lines = text_of(labels=kind)
    owner = marked(lines)
    stages = sliced(labels=kind)
    assert stages.labels is not None
    x = y = 0.0
    seen = set()
    for line, name in zip(lines, owner, strict=True):
        found = dict(re.findall(r" ([XY])(-?[\d.]+)", line)) if re.match("G[01] ", line) else {}
        x, y = float(found.get("X", x)), float(found.get("Y", y))
        if line.startswith("G1 X") and name:
            (low_x, low_y), (high_x, high_y) = stages.labels.boxes[NAMES.index(name)]
            assert low_x < x < high_x
            assert low_y < y < high_y
            seen.add(name)

    assert seen == set(NAMES)
    first = next(i for i, name in enumerate(owner) if name)
    types = [line for line, name in zip(lines, owner, strict=True) if name and line.startswith(";TYPE:Skirt")]
    assert types == []
    assert any(line == ";TYPE:Skirt/Brim" for line in lines[:first])


@pytest.mark.parametrize(
    ("flavour", "start", "stop", "definition"),
    [
        ("marlin", "; printing object cone id:1 copy 0", "; stop printing object cone id:1 copy 0", ""),
        ("smoothie", "; printing object cone id:1 copy 0", "; stop printing object cone id:1 copy 0", ""),
        (
            "klipper",
            "EXCLUDE_OBJECT_START NAME=cone",
            "EXCLUDE_OBJECT_END NAME=cone",
            "EXCLUDE_OBJECT_DEFINE NAME=cone",
        ),
        ("reprapfirmware", 'M486 S1 A"cone"', "M486 S-1", "M486 T3"),
        ("prusa", "M486 Acone", "M486 S-1", "M486 T3"),
    ],
)
def test_each_flavour_marks_in_its_own_words(flavour: str, start: str, stop: str, definition: str) -> None:
    lines = text_of(flavour=flavour)

    assert lines.index(start) < lines.index(stop)
    assert not definition or any(line.startswith(definition) for line in lines[: lines.index(start)])


def test_klipper_is_told_where_things_stand() -> None:
    lines = [line for line in text_of(flavour="klipper") if line.startswith("EXCLUDE_OBJECT_DEFINE")]
    stages = sliced(flavour="klipper")
    assert stages.labels is not None
    middles = stages.labels.boxes.mean(axis=1)

    told = np.array([re.findall(r"CENTER=(.+),(.+)$", line)[0] for line in lines], float)
    assert told == pytest.approx(middles, abs=0.05)


@cache
def plate_on_any_printer() -> Stages:
    return slice_stages(plate(), profile(skirt_loops=1, thumbnails=""))


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_plates_of_every_flavour_print_as_intended(flavour: str) -> None:
    usual = profile(flavour=flavour, skirt_loops=1, thumbnails="")
    verdict = dry_run(job_of(plate_on_any_printer(), usual), usual)

    assert verdict.problems == ()


def test_a_single_thing_is_not_marked_and_nothing_is_where_nobody_wants_to_know() -> None:
    one = slice_stages(box((10, 10, 1)), wanted(labels="m486"))
    none = slice_stages(plate(), wanted(labels="none"))

    assert one.labels is None
    assert b"M486" not in gcode_of(one.program, wanted(labels="m486"), labels=one.labels)
    assert not [line for line in text_of(labels="none") if STARTS.match(line)]
    assert none.labels is not None


def test_names_are_plain_short_and_all_different() -> None:
    names = ["a b/ü.stl", "a b/ü.stl", "", "x" * 60, "cone", 'q"; M112']
    meshes = [named(box((3, 3, 0.4)), name, (6 * i, 0, 0)) for i, name in enumerate(names)]
    stages = slice_stages(join(meshes), plain())

    assert stages.labels is not None
    assert stages.labels.names == ("a_b_stl", "a_b_stl_2", "object", "x" * 24, "cone", "q_M112")


def test_a_thing_in_the_hollow_of_another_is_itself() -> None:
    """Their envelopes hold each other's beads."""
    frame, core = box_with_hole((30, 30, 2), (20, 20)), box((6, 6, 2))
    at = frame.bounds.mean(axis=0) - core.bounds.mean(axis=0)
    both = join([named(frame, "frame", (0, 0, 0)), named(core, "core", (at[0], at[1], 0))])
    stages = slice_stages(both, plain())
    assert stages.labels is not None
    part = stages.labels.object_id >= 0
    far = np.abs(stages.program.xyz[part, :2] - stages.part.bounds.mean(axis=0)[:2]).max(axis=1)

    assert (stages.labels.object_id[part] == (far < 4)).all()
    assert set(stages.labels.object_id.tolist()) == {-1, 0, 1}


def test_things_are_known_when_they_were_turned_scaled_and_mended() -> None:
    meshes = plate()
    turned = transform(Mesh(meshes.triangles, "plate", meshes.objects), scale=2, rotate=(0, 0, 90))
    torn = Mesh(np.delete(turned.triangles, 3, axis=0), "torn", turned.objects)

    for mesh in (turned, torn):
        stages = slice_stages(mesh, plain())
        assert stages.labels is not None
        lays = stages.program.role != Role.TRAVEL
        for k, (low, high) in enumerate(stages.labels.boxes):
            inside = ((stages.program.xyz[:, :2] > low - 0.1) & (stages.program.xyz[:, :2] < high + 0.1)).all(
                axis=1
            )
            assert (stages.labels.object_id[lays & inside] == k).all()
            assert (lays & inside).sum() > 50


def test_a_raft_belongs_to_nobody_and_carries_all() -> None:
    usual = plain(raft_height=0.6)
    stages = slice_stages(plate(), usual)
    assert stages.labels is not None
    raft = stages.program.role == Role.RAFT

    assert raft.any()
    assert (stages.labels.object_id[raft] == -1).all()
    assert set(stages.labels.object_id[(stages.program.role > Role.RAFT)].tolist()) == {0, 1, 2}


def test_the_items_of_a_plate_in_one_file_are_marked(tmp_path: Path) -> None:
    shapes = {1: mesh_xml(), 2: mesh_xml()}
    text = model_xml(shapes, item(1) + item(2, (1, 0, 0, 0, 1, 0, 0, 0, 1, 40, 0, 0))).replace(
        '<object id="2"', '<object name="second one" id="2"'
    )
    path = write(tmp_path, three_mf(text), "plate.3mf")
    lines = job_from(path, wanted(labels="m486")).text.decode().splitlines()

    assert lines.index("M486 Aplate") < lines.index("M486 Asecond_one")


def test_macros_may_name_the_things() -> None:
    lines = text_of(start_gcode="M117 {size(object_names)}: {object_names}")

    assert "M117 3: cube, cone, post" in lines


def test_the_command_line_marks_its_models(tmp_path: Path) -> None:
    from printer_slicer.cli import main
    from printer_slicer.mesh_io import export_stl

    for mesh, name in ((box((8, 8, 1)), "left.stl"), (box((8, 8, 1), (20, 0, 0)), "right.stl")):
        export_stl(mesh, tmp_path / name)
    output = tmp_path / "both.gcode"
    files = [str(tmp_path / name) for name in ("left.stl", "right.stl")]

    assert main(["slice", *files, "-o", str(output), "--printer", "corexy_klipper", "--quiet"]) == 0
    lines = output.read_text().splitlines()
    assert "EXCLUDE_OBJECT_START NAME=left" in lines
    assert "EXCLUDE_OBJECT_END NAME=right" in lines
    assert [line for line in commands("\n".join(lines).encode()) if len(line) > 80] == []


@pytest.mark.parametrize(("labels", "gone"), crossed(KINDS, NAMES))
def test_a_thing_that_is_given_up_takes_no_temperature_fan_or_acceleration_with_it(
    labels: str, gone: str
) -> None:
    """What a printer knows at every bead of the others is what it would have known."""
    changes = {
        "printer.labels": labels,
        "first_layer_nozzle_temperature": 220,
        "fan_full_above": 2.5,
        "quality.accelerations.external_perimeter": 300,
    }
    lines = text_of(**changes)
    owner = marked(lines)

    def known(taken: list[bool]) -> list[tuple[str, ...]]:
        """For each line that lays a bead of another thing, what was said last of each kind."""
        said: dict[str, str] = {}
        found = []
        for line, one, read in zip(lines, owner, taken, strict=True):
            code = line.partition(" ")[0]
            if read and code in ("M104", "M140", "M106", "M107", "M204", ";LAYER_CHANGE"):
                said["fan" if code in ("M106", "M107") else code] = line
            if one not in ("", gone) and line.startswith("G1 X"):
                found.append(tuple(sorted(said.values())))
        return found

    everything = known([True] * len(lines))
    assert known([one != gone for one in owner]) == everything
    assert len(set(everything)) > 3
