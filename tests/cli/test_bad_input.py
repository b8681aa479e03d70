"""Bad input of every kind: the right exit code, one message that names place and remedy, never a traceback."""

from __future__ import annotations

import gzip
import os
import socket
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import BOX, MACHINE, PARTS, QUICK, Outcome, is_message, process, typed
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh

GOOD = BOX.read_bytes()
ASCII = b"solid x\n facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 0 1 0\n"
MODEL_COMMANDS = (["slice"], ["plan"], ["dry-run"], ["print", "--port", "sim:"])
AS_ROOT = hasattr(os, "geteuid") and os.geteuid() == 0


def refused(outcome: Outcome, code: int, *parts: object) -> None:
    """The command ended with this code, and all parts in its message with a remedy; on stdout only its machine."""
    assert outcome.code == code, outcome.err
    assert len(outcome.out.splitlines()) <= 1, "more than what machine, material and quality are"
    assert is_message(outcome, *parts)
    assert len(outcome.err.splitlines()) >= 2, "no remedy"


def with_value(place: int, value: float) -> bytes:
    """The box with another number in one coordinate of its first facet."""
    data = bytearray(GOOD)
    struct.pack_into("<f", data, 84 + 12 + 4 * place, value)
    return bytes(data)


def stretched(folder: Path, name: str, x: float, y: float, z: float) -> Path:
    """The box with other edges, mm."""
    box = load_mesh(BOX)
    export_stl(Mesh(box.triangles * np.array([x, y, z]) / box.size), folder / name)
    return folder / name


# Files that are no parts


BAD_MODELS = [
    ("empty.stl", b"", 3, ["empty.stl", "empty"]),
    ("words.stl", b"this is no mesh\n" * 10, 3, ["words.stl"]),
    ("letter.txt", b"dear sir\n", 2, ["letter.txt", ".stl"]),
    ("picture.stl", b"\x89PNG\r\n\x1a\n" + bytes(200), 3, ["picture.stl"]),
    ("half.stl", GOOD[: len(GOOD) // 2], 3, ["half.stl", "12", "facets"]),
    ("head.stl", GOOD[:60], 3, ["head.stl"]),
    ("none.stl", GOOD[:80] + bytes(4), 3, ["none.stl"]),
    ("long.stl", GOOD + GOOD[84:], 3, ["long.stl", "12", "24"]),
    ("ascii.stl", ASCII, 3, ["ascii.stl", "line 6"]),
    ("ends.stl", ASCII + b"  endloop\n", 3, ["ends.stl", "line 7", "ends in the middle of a facet"]),
    ("open.stl", b"solid x\n", 3, ["open.stl", "line 1", "endsolid"]),
    (
        "word.stl",
        ASCII.replace(b"1 0 0", b"one 0 0") + b"  endloop\n endfacet\nendsolid\n",
        3,
        ["word.stl", "line 5"],
    ),
    ("nan.stl", with_value(4, float("nan")), 3, ["nan.stl", "facet 1", "nan"]),
    ("inf.stl", with_value(4, float("inf")), 3, ["inf.stl", "facet 1", "inf"]),
    ("far.stl", with_value(4, 1e30), 3, ["far.stl", "facet 1"]),
    ("odd.3mf", b"PK\x03\x04 no zip", 3, ["odd.3mf"]),
    ("odd.obj", b"v 0 0\nf 1 2 99\n", 3, ["odd.obj"]),
    ("box.stl.gz", gzip.compress(GOOD), 2, ["box.stl.gz: the file is a compressed archive", "Unpack it"]),
    ("box.stl", gzip.compress(GOOD), 2, ["box.stl: the file is a compressed archive", "Unpack it"]),
    (
        "box.7z",
        b"7z\xbc\xaf\x27\x1c" + bytes(99),
        2,
        ["box.7z: the file is a compressed archive", "Unpack it"],
    ),
    ("odd.ply", b"ply\nformat ascii 1.0\n", 3, ["odd.ply"]),
]


@pytest.mark.parametrize(("name", "data", "code", "parts"), BAD_MODELS, ids=[row[0] for row in BAD_MODELS])
def test_a_file_that_is_no_part_is_refused(
    name: str, data: bytes, code: int, parts: list[str], tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(data)

    refused(typed("slice", tmp_path / name, "-o", tmp_path / "x.gcode"), code, *parts)
    assert not (tmp_path / "x.gcode").exists()


@pytest.mark.parametrize("command", MODEL_COMMANDS, ids=lambda words: words[0])
def test_every_command_refuses_a_file_that_is_not_there(command: list[str], tmp_path: Path) -> None:
    refused(typed(command[0], "nowhere.stl", *command[1:], cwd=tmp_path), 2, "nowhere.stl", "no such file")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", MODEL_COMMANDS, ids=lambda words: words[0])
@pytest.mark.parametrize("name", [".", "..", "", "/", "folder", "folder.stl", "folder.gcode"])
def test_every_command_refuses_a_folder(command: list[str], name: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.stl").mkdir()
    (tmp_path / "folder.gcode").mkdir()

    refused(typed(command[0], name, *command[1:], cwd=tmp_path), 2)


@pytest.mark.parametrize("name", ["a\0b.stl", "x" * 300 + ".stl", "a\0b.gcode"])
def test_a_name_that_no_file_can_have_is_refused(name: str, tmp_path: Path) -> None:
    refused(typed("dry-run", name, cwd=tmp_path), 2)


@pytest.mark.skipif(AS_ROOT, reason="root may read everything")
def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path) -> None:
    for name in ("secret.stl", "secret.gcode", "secret.toml"):
        (tmp_path / name).write_bytes(GOOD)
        (tmp_path / name).chmod(0)

    refused(typed("slice", tmp_path / "secret.stl"), 2, "secret.stl", "permissions")
    refused(typed("dry-run", tmp_path / "secret.gcode"), 2, "secret.gcode", "permissions")
    refused(typed("slice", BOX, "--printer", tmp_path / "secret.toml"), 2, "secret.toml", "permissions")


# Parts that cannot be printed


def test_a_flat_mesh_is_refused(tmp_path: Path) -> None:
    triangles = load_mesh(BOX).triangles.copy()
    triangles[:, :, 2] = 0
    export_stl(Mesh(triangles), tmp_path / "flat.stl")

    refused(typed("slice", tmp_path / "flat.stl"), 3, "flat.stl", "z")


def test_a_mesh_without_volume_is_refused(tmp_path: Path) -> None:
    one = np.array([[[0, 0, 0], [10, 0, 5], [0, 10, 2]]], dtype=np.float64)
    export_stl(Mesh(np.concatenate([one, one[:, ::-1]])), tmp_path / "sheet.stl")

    refused(typed("slice", tmp_path / "sheet.stl"), 3, "sheet", "volume")


@pytest.mark.parametrize("edges", [(300, 20, 10), (20, 221, 10), (20, 20, 251), (2000, 2000, 2000)], ids=str)
def test_a_part_larger_than_the_printer_is_refused(edges: tuple[float, float, float], tmp_path: Path) -> None:
    part = stretched(tmp_path, "large.stl", *edges)

    refused(
        typed("slice", part, *QUICK), 3, "large", "220 x 220 x 250", f"{edges[0]} x {edges[1]} x {edges[2]}"
    )


def test_a_part_in_metres_is_refused_as_too_thin_and_the_unit_is_doubted(tmp_path: Path) -> None:
    part = stretched(tmp_path, "metres.stl", 0.02, 0.02, 0.01)

    refused(typed("slice", part, *QUICK), 3, "metres", "unit")


def test_a_part_thinner_than_the_thinnest_layer_is_refused(tmp_path: Path) -> None:
    part = stretched(tmp_path, "foil.stl", 20, 20, 0.05)

    refused(typed("slice", part, *QUICK), 3, "foil", "0.05 mm", "0.08 mm")


@pytest.mark.parametrize("planner", ["uniform", "area"])
def test_a_part_too_narrow_for_any_bead_is_refused(planner: str, tmp_path: Path) -> None:
    """A file that prints nothing must not be called a success."""
    part = stretched(tmp_path, "needle.stl", 0.08, 0.08, 5)

    refused(typed("slice", part, *QUICK[:-2], "--planner", planner), 3, "needle")


def test_a_small_hole_in_the_mesh_is_closed_and_told(tmp_path: Path) -> None:
    export_stl(Mesh(load_mesh(PARTS / "cylinder.stl").triangles[1:]), tmp_path / "open.stl")
    outcome = typed("slice", tmp_path / "open.stl", *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert "repaired: holes filled: 1, first at x" in outcome.out


# Names and settings


@pytest.mark.parametrize("flag", ["--printer", "--material", "--quality"])
def test_an_unknown_profile_is_refused_and_the_known_ones_are_listed(flag: str) -> None:
    refused(typed("slice", BOX, flag, "nothing"), 2, flag.strip("-"), "nothing", "accepted too")


@pytest.mark.parametrize("flag", ["--printer", "--material", "--quality"])
def test_a_profile_file_that_is_not_there_is_refused(flag: str) -> None:
    refused(typed("slice", BOX, flag, "nowhere/mine.toml"), 2, flag.strip("-"), "nowhere/mine.toml")


BAD_SETTINGS = [
    ("infil_density=0.2", ["infil_density", "Did you mean 'infill_density'"]),
    ("quality.perimetres=3", ["perimetres", "Did you mean 'quality.perimeters'"]),
    ("infill_density=2", ["--set infill_density=2: ", "<= 1"]),
    ("infill_density=-0.1", ["--set infill_density=-0.1: ", ">= 0"]),
    ("speeds.travel=-1", ["--set speeds.travel=-1: ", ">= 0"]),
    ("infill_density=much", ["--set infill_density=much: ", "expected a number", "much"]),
    ("perimeters=1.5", ["--set perimeters=1.5: expected a whole number"]),
    ("perimeters=", ["--set perimeters=: expected a whole number"]),
    (
        "relative_extrusion=perhaps",
        ["--set relative_extrusion=perhaps: ", "expected true or false", "perhaps"],
    ),
    ("seam=front", ["--set seam=front: ", "front", "aligned", "nearest", "rear"]),
    ("planner.kind=cosp", ["--set planner.kind=cosp: ", "cosp", "uniform", "area"]),
    ("planner=area", ["planner", "planner.kind"]),
    ("name=x", ["name", "printer.name", "material.name", "quality.name"]),
    ("layer_height=0.5", ["--set layer_height=0.5: ", "0.5", "0.32"]),
    ("layer_height=0.2012", ["--set layer_height=0.2012: ", "0.2012", "z_step", "0.2", "0.2025"]),
    ("nozzle_temperature=300", ["--set nozzle_temperature=300: ", "300", "260"]),
    ("perimeters", ["--set perimeters", "KEY=VALUE"]),
    ("=3", ["--set =3", "KEY=VALUE"]),
    ("", ["--set", "KEY=VALUE"]),
    ("start_gcode=G1 X{bed_xx}", ["start_gcode", "bed_xx", "{bed_x}"]),
]


@pytest.mark.parametrize(("setting", "parts"), BAD_SETTINGS, ids=[row[0] for row in BAD_SETTINGS])
def test_a_setting_that_cannot_be_is_refused(setting: str, parts: list[str], tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "x.gcode", *QUICK[:-2], f"--set={setting}")

    refused(outcome, 2, *parts)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", MODEL_COMMANDS, ids=lambda words: words[0])
def test_an_unknown_planner_is_refused_and_the_known_ones_are_listed(command: list[str]) -> None:
    refused(
        typed(command[0], BOX, *command[1:], "--planner", "cosp"), 2, "planner", "cosp", "uniform", "area"
    )


BAD_PROFILES = [
    ("broken", 'name = "x\n', ["broken.toml:1: not valid TOML"]),
    ("unknown", 'inherits = "standard"\nperimetres = 3\n', ["perimetres", "perimeters"]),
    ("table", 'inherits = "standard"\n[spedes]\ntravel = 3\n', ["spedes"]),
    ("bound", 'inherits = "standard"\ninfill_density = 1.5\n', ["quality.infill_density", "<= 1", "1.5"]),
    ("type", 'inherits = "standard"\nperimeters = "many"\n', ["quality.perimeters", "int", "many"]),
    ("parent", 'inherits = "nobody"\n', ["nobody", "standard"]),
    ("empty", "", ["name"]),
    ("conflict", 'inherits = "standard"\nlayer_height = 0.5\n', ["quality.layer_height", "0.32"]),
]


@pytest.mark.parametrize(("name", "text", "parts"), BAD_PROFILES, ids=[row[0] for row in BAD_PROFILES])
def test_a_profile_file_that_cannot_be_used_is_refused(
    name: str, text: str, parts: list[str], tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.toml"
    path.write_text(text, encoding="utf-8")

    refused(typed("slice", BOX, "--printer", "marlin_220", "--quality", path), 2, path, *parts)


def test_profile_files_that_inherit_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text('inherits = "./two.toml"\n', encoding="utf-8")
    (tmp_path / "two.toml").write_text('inherits = "./one.toml"\n', encoding="utf-8")

    refused(typed("slice", BOX, "--quality", "one.toml", cwd=tmp_path), 2, "one.toml", "two.toml")


def test_profile_files_find_each_other_wherever_the_command_is_typed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "base.toml").write_text('inherits = "standard"\nperimeters = 4\n', encoding="utf-8")
    (tmp_path / "mine" / "top.toml").write_text('inherits = "base.toml"\n', encoding="utf-8")
    outcome = typed("slice", BOX, "-o", "x.gcode", "--quality", "mine/top.toml", cwd=tmp_path)

    assert outcome.code == 0, outcome.err
    assert "; quality.perimeters = 4\n" in (tmp_path / "x.gcode").read_text(encoding="utf-8")


def test_a_machine_without_a_heated_bed_is_told_what_to_change() -> None:
    refused(typed("slice", BOX, "--set", "max_bed_temperature=0", *QUICK), 2, "bed_temperature", "0")


# Output


@pytest.mark.parametrize("output", ["missing/x.gcode", "", "model.stl/x.gcode"])
def test_an_output_that_cannot_be_written_is_refused(output: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "model.stl").write_bytes(GOOD)
    outcome = typed("slice", "model.stl", "-o", output, *QUICK, cwd=tmp_path)

    refused(outcome, 2, output)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "model.stl"]


@pytest.mark.parametrize("output", ["a\0b.gcode", "x" * 300 + ".gcode"])
def test_an_output_that_no_file_can_be_called_is_refused(output: str, tmp_path: Path) -> None:
    refused(typed("slice", BOX, "-o", output, *QUICK, cwd=tmp_path), 2)
    assert list(tmp_path.iterdir()) == []


def test_an_output_with_the_longest_name_a_file_may_have_is_written(tmp_path: Path) -> None:
    name = "x" * 249 + ".gcode"
    outcome = typed("slice", BOX, "-o", name, *QUICK, cwd=tmp_path)

    assert (outcome.code, outcome.err) == (0, "")
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize(
    "command",
    [
        ["slice", BOX, "-o", "/dev/full"],
        ["slice", BOX, "-o", "x.gcode", "--picture", "/dev/full"],
        ["plan", BOX, "--picture", "/dev/full"],
    ],
    ids=["gcode", "layer", "plan"],
)
def test_a_full_disk_is_named(command: list[object], tmp_path: Path) -> None:
    refused(typed(*command, *QUICK, cwd=tmp_path), 2, "/dev/full", "No space left")


def test_a_failure_keeps_the_older_good_file(tmp_path: Path) -> None:
    old = tmp_path / "x.gcode"
    old.write_text("G28 ; old and good\n", encoding="utf-8")
    for bad in (
        ["--set", "infill_density=2"],
        ["--picture", "missing/l.svg"],
        ["--picture", "l.svg", "--layer", "999"],
    ):
        outcome = typed("slice", BOX, "-o", "x.gcode", *QUICK, *bad, cwd=tmp_path)

        assert outcome.code == 2
        assert old.read_text(encoding="utf-8") == "G28 ; old and good\n", bad
    assert [path.name for path in tmp_path.iterdir()] == ["x.gcode"]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="limits of file size are a thing of Unix")
def test_a_file_that_cannot_be_finished_leaves_the_older_one_as_it_was(tmp_path: Path) -> None:
    """The disk takes some kilobytes and then no more: the older file stays, and nothing half is left."""
    import resource

    old = tmp_path / "x.gcode"
    old.write_text("G28 ; old and good\n", encoding="utf-8")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        outcome = typed("slice", BOX, "-o", old, *QUICK)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    refused(outcome, 2, old)
    assert old.read_text(encoding="utf-8") == "G28 ; old and good\n"
    assert list(tmp_path.iterdir()) == [old]


def test_a_link_to_the_output_stays_a_link(tmp_path: Path) -> None:
    """Else `-o /dev/stdout` with stdout sent to a file would replace the system's /dev/stdout."""
    (tmp_path / "disk").mkdir()
    real, link = tmp_path / "disk" / "real.gcode", tmp_path / "link.gcode"
    real.write_text("old", encoding="utf-8")
    link.symlink_to(real)
    outcome = typed("slice", BOX, "-o", link, *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert link.is_symlink()
    assert real.read_text(encoding="utf-8").startswith("; generated")


def test_a_link_that_leads_to_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.gcode").symlink_to("loop.gcode")

    refused(typed("slice", BOX, "-o", tmp_path / "loop.gcode", *QUICK), 2, "loop.gcode")
    assert [path.name for path in tmp_path.iterdir()] == ["loop.gcode"]


def test_an_output_gets_the_usual_permissions_and_keeps_those_it_has(tmp_path: Path) -> None:
    new, old, usual = tmp_path / "new.gcode", tmp_path / "old.gcode", tmp_path / "usual"
    usual.touch()
    old.touch()
    old.chmod(0o640)
    for output in (new, old):
        assert typed("slice", BOX, "-o", output, *QUICK).code == 0

    assert new.stat().st_mode == usual.stat().st_mode
    assert old.stat().st_mode & 0o777 == 0o640


def test_the_model_is_never_overwritten_by_its_own_gcode(tmp_path: Path) -> None:
    model = tmp_path / "part.stl"
    model.write_bytes(GOOD)
    outcome = typed("slice", model, "-o", model, *QUICK)

    assert model.read_bytes() == GOOD
    refused(outcome, 2, model)


# Ports


@pytest.mark.parametrize("port", ["/dev/no_such_port", "", "nonsense://x", "/dev/null", "/"])
def test_a_port_that_is_none_is_a_port_error(port: str, tmp_path: Path) -> None:
    outcome = typed("print", BOX, "--port", port, "-q", *QUICK, cwd=tmp_path)

    refused(outcome, 4, port)
    assert list(tmp_path.iterdir()) == []


def test_a_regular_file_is_no_port_and_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine", encoding="utf-8")
    outcome = typed("print", BOX, "--port", tmp_path / "notes.txt", "-q", *QUICK, cwd=tmp_path)

    refused(outcome, 4, "notes.txt", "not a serial port")
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == "mine"


def test_a_printer_on_the_network_that_does_not_answer_is_a_port_error(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # and never listens
        address = f"socket://127.0.0.1:{taken.getsockname()[1]}"
        outcome = typed("print", BOX, "--port", address, "-q", *QUICK, cwd=tmp_path)

    refused(outcome, 4, address, "refused")


def test_a_network_address_without_a_port_number_is_explained(tmp_path: Path) -> None:
    outcome = typed("print", BOX, "--port", "socket://printer", "-q", *QUICK, cwd=tmp_path)

    refused(outcome, 4, "socket://printer")
    assert "not supported between instances" not in outcome.err


@pytest.mark.parametrize("baud", ["0", "-9600", "fast"])
def test_a_speed_of_the_port_that_cannot_be_is_a_usage_error(baud: str, tmp_path: Path) -> None:
    outcome = typed("print", BOX, "--port", "/dev/no_such_port", f"--baud={baud}", "-q", *QUICK, cwd=tmp_path)

    assert outcome.code == 2
    assert "--baud" in outcome.err


# G-code


BAD_GCODE = [
    ("empty", b"", ["no commands"]),
    ("comments", b"; only\n; comments\n", ["no commands"]),
    ("binary", bytes(range(256)) * 20, []),
    ("picture", b"\x89PNG\r\n\x1a\n" + bytes(1000), []),
    ("zero byte", b"G28\n; a comment\nG1 X\0 5\n", ["line 3"]),
    ("too long", b"; a header\n\nG28\nM117 " + b"x" * 100 + b"\n", ["line 4", "105 bytes"]),
    ("old line breaks", b"G28\rG1 X5 F3000\r", ["line 1"]),
]


@pytest.mark.parametrize("command", [["dry-run"], ["print", "--port", "sim:"]], ids=lambda words: words[0])
@pytest.mark.parametrize(("name", "data", "parts"), BAD_GCODE, ids=[row[0] for row in BAD_GCODE])
def test_a_file_that_can_never_be_sent_is_refused_with_its_name_and_line(
    command: list[str], name: str, data: bytes, parts: list[str], tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.gcode"
    path.write_bytes(data)

    refused(typed(command[0], path, *command[1:], "-q", *MACHINE), 2, f"{name}.gcode", *parts)


@pytest.mark.parametrize(
    ("text", "culprit"),
    [
        ("G28\nG1 X500 F3000\n", "X500"),
        ("G28\nG1 X5 E5 F3000\n", "E5"),
        ("G1 X50 F3000\n", "X50"),
        ("hello world\n", "hello"),
    ],
)
def test_a_file_that_must_not_be_printed_fails_the_rehearsal_at_its_line(
    text: str, culprit: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.gcode"
    path.write_text("; a header\n\n" * 10 + text, encoding="utf-8")
    line = 20 + [culprit in line for line in text.splitlines()].index(True) + 1
    outcome = typed("dry-run", path, "-q", *MACHINE)

    assert (outcome.code, outcome.out) == (7, "")
    assert is_message(outcome, "bad.gcode", f"line {line}", culprit)


def test_what_a_file_holds_never_controls_the_terminal(tmp_path: Path) -> None:
    """A message may quote a line of a file from anywhere, but not its escape codes."""
    path = tmp_path / "evil.gcode"
    path.write_bytes(b"\x1b]0;title\x07\x1b[2J\n")
    outcome = typed("dry-run", path, *QUICK)

    assert outcome.code in {2, 7}
    assert is_message(outcome, "evil.gcode")
    assert "\x1b" not in outcome.out


@pytest.mark.parametrize("command", [["dry-run"], ["print", "--port", "sim:"]], ids=lambda words: words[0])
def test_gcode_is_not_refused_because_of_settings_that_only_slicing_needs(
    command: list[str], tmp_path: Path
) -> None:
    """The file is ready: that the default quality does not suit a fine nozzle plays no role."""
    fine = (
        'inherits = "marlin_220"\nname = "fine"\nnozzle_diameter = 0.2\nmin_layer = 0.04\nmax_layer = 0.14\n'
    )
    (tmp_path / "fine.toml").write_text(fine, encoding="utf-8")
    (tmp_path / "x.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    outcome = typed(command[0], "x.gcode", *command[1:], "--printer", "fine.toml", cwd=tmp_path)

    assert (outcome.code, outcome.err) == (0, "")


def test_gcode_cannot_be_sliced(tmp_path: Path) -> None:
    (tmp_path / "x.gcode").write_text("G28\n", encoding="utf-8")
    for command in ("slice", "plan"):
        refused(typed(command, tmp_path / "x.gcode"), 2, "x.gcode")
    assert (tmp_path / "x.gcode").read_text(encoding="utf-8") == "G28\n"


# Anything at all


@given(
    st.binary(max_size=300), st.sampled_from(["x.stl", "x.gcode", "x.obj", "x.ply", "x.off", "x.toml", "x"])
)
def test_no_file_whatever_makes_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, name: str
) -> None:
    folder = tmp_path_factory.getbasetemp()
    (folder / name).write_bytes(data)
    if name.endswith("toml"):
        outcome = typed("slice", BOX, "--quality", folder / name, "-o", folder / "out.gcode")
    else:
        outcome = typed("dry-run", folder / name)

    assert outcome.code in {0, 2, 3, 7}
    assert outcome.code == 0 or is_message(outcome, name)


@given(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Zl", "Zp")), max_size=20))
def test_no_setting_whatever_makes_a_traceback(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path_factory.getbasetemp() / "x.gcode", f"--set={text}")

    assert outcome.code == 2
    assert is_message(outcome, "--set")


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["slice", "nowhere.stl"], 2),
        (["slice", "empty.stl"], 3),
        (["print", "x.gcode", "--port", "/dev/no_such_port", "--allow", "homing"], 4),
        (["dry-run", "x.gcode"], 7),
    ],
    ids=["usage", "part", "port", "verification"],
)
@pytest.mark.parametrize("run", [typed, pytest.param(process, marks=pytest.mark.thorough)])
def test_exit_codes_are_those_of_what_went_wrong(
    run: Callable[..., Outcome], arguments: list[str], code: int, tmp_path: Path
) -> None:
    """That they reach the shell, a process tells for one of them, in `test_cli.py`."""
    (tmp_path / "empty.stl").touch()
    (tmp_path / "x.gcode").write_text(f"G1 X{500 if code == 7 else 50}\n", encoding="utf-8")
    outcome = run(*arguments, "-q", cwd=tmp_path)

    refused(outcome, code) if code != 7 else is_message(outcome, "x.gcode")
    assert outcome.code == code
