"""A preview says what the moves of the file are, and its bytes say what the preview is."""

from __future__ import annotations

import gzip
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from printer_slicer.errors import UsageError
from printer_slicer.gcode import read_moves
from printer_slicer.motion.rules import limits_of
from printer_slicer.preview import Preview, PreviewRole, decode_preview, encode_preview, read_preview
from printer_slicer.preview.columns import DERETRACTION, JUMP, NO_EXTRUSION_ROLES, RETRACTION, TRAVEL
from printer_slicer.profile import load_profile

LIMITS = limits_of(load_profile().printer)
NAMES = {
    "PrusaSlicer": (";LAYER_CHANGE", ";TYPE:External perimeter", ";TYPE:Perimeter"),
    "OrcaSlicer": ("; CHANGE_LAYER", "; FEATURE: Outer wall", "; FEATURE: Inner wall"),
    "Cura": (";LAYER:0", ";TYPE:WALL-OUTER", ";TYPE:WALL-INNER"),
}


def two_layers(slicer: str) -> bytes:
    """Two layers of two walls, with a retraction and a hop between them."""
    layer, outer, inner = NAMES[slicer]
    lines = ["G28", "M83", "T0", "G1 F3000"]
    for z in (0.2, 0.4):
        lines += [layer, f"G1 Z{z} F600", outer, "G1 X10 Y10 F9000"]
        lines += ["G1 X30 Y10 E0.7 F1800", "G1 X30 Y30 E0.7", "G1 X10 Y30 E0.7", "G1 X10 Y10 E0.7"]
        lines += ["G1 E-1 F2400", f"G1 Z{z + 0.3:g}", inner, "G1 X11 Y11 F9000", f"G1 Z{z:g}", "G1 E1"]
        lines += ["G1 X29 Y11 E0.6 F3000", "G1 X29 Y29 E0.6", "G1 X11 Y11 E0.6"]
    return "\n".join(lines).encode()


@pytest.mark.parametrize("slicer", NAMES)
def test_rows_are_the_moves_of_the_file(slicer: str) -> None:
    text = two_layers(slicer)
    preview = read_preview(text, "part", LIMITS)
    moves = read_moves([line for line in text.split(b"\n") if not line.startswith(b";")])
    assert np.array_equal(preview.points[1:], moves.end)
    assert preview.speed.tolist() == moves.speed.tolist()
    assert preview.n_layers == 2
    assert preview.layer_z.tolist() == pytest.approx([0.2, 0.4])
    outer = [i for i, role in enumerate(preview.roles) if role.is_outer]
    assert len(outer) == 1
    assert (preview.role == outer[0]).sum() == 8
    assert (preview.role == RETRACTION).sum() == (preview.role == DERETRACTION).sum() == 2
    assert preview.is_extrusion.sum() == 14
    # The volume is that of the filament, and the flow is the volume in the time at the requested speed.
    length = np.hypot(*np.diff(preview.points[:, :2], axis=0).T)
    is_extrusion = preview.is_extrusion
    seconds = length[is_extrusion] / preview.speed[is_extrusion]
    fed = 2 * (4 * 0.7 + 3 * 0.6) * np.pi * 1.75**2 / 4
    assert float(preview.flow[is_extrusion] @ seconds) == pytest.approx(fed, rel=1e-6)


def test_layers_start_after_the_last_extrusion_of_the_layer_before() -> None:
    preview = read_preview(two_layers("PrusaSlicer"), "part", LIMITS)
    first = int(preview.first[1])
    assert preview.is_extrusion[first - 1]
    assert preview.role[first] == TRAVEL
    assert preview.layer_seconds.sum() == pytest.approx(
        read_moves(two_layers("PrusaSlicer").split(b"\n")).seconds(LIMITS)
    )


def test_objects_one_after_the_other_keep_their_order() -> None:
    text = two_layers("PrusaSlicer")
    second = text.replace(b"G28", b"").replace(b"X", b"X1").replace(b"Z0.7", b"Z5")
    preview = read_preview(text + b"\nG1 Z5\n" + second, "two", LIMITS)
    assert preview.layer_z.tolist() == pytest.approx([0.2, 0.4, 0.2, 0.4])


def test_a_change_of_position_without_a_move_is_a_jump() -> None:
    text = two_layers("PrusaSlicer") + b"\nG28\nG1 X50 Y50\nG1 X60 Y50 E1"
    preview = read_preview(text, "part", LIMITS)
    (jump,) = np.flatnonzero(preview.role == JUMP)
    assert preview.points[jump].tolist() == pytest.approx([11, 11, 0.4])
    assert preview.points[jump + 1].tolist() == [0, 0, 0]


@pytest.mark.parametrize("text", [b"", b"G28\nG1 X10 Y10", b"GCDE\x01\x00\x00\x00"])
def test_files_without_extrusions_are_rejected(text: bytes) -> None:
    with pytest.raises(UsageError):
        read_preview(text, "part", LIMITS)


def columns(n_moves: int, n_layers: int) -> st.SearchStrategy[dict[str, Any]]:
    """Columns of a preview of any moves that a machine can make."""
    place = st.floats(-3000, 3000, width=32) | st.floats(-100, 300, width=32)

    def column(top: float) -> st.SearchStrategy[Any]:
        return arrays(np.float64, n_moves, elements=st.floats(0, top, width=32))

    def of_layer(top: float) -> st.SearchStrategy[Any]:
        return arrays(np.float64, n_layers, elements=st.floats(0, top, width=32))

    return st.fixed_dictionaries(
        {
            "points": arrays(np.float64, (n_moves + 1, 3), elements=place),
            "role": arrays(np.int64, n_moves, elements=st.integers(0, 5)),
            "width": column(300),
            "height": column(60),
            "speed": column(6000),
            "tool": arrays(np.int64, n_moves, elements=st.integers(0, 255)),
            "first": arrays(np.int64, n_layers, elements=st.integers(0, max(n_moves - 1, 0))),
            "layer_z": of_layer(300),
            "layer_height": of_layer(2),
            "layer_seconds": of_layer(1e5),
            "layer_command": arrays(np.int64, n_layers, elements=st.integers(0, 10**9)),
        }
    )


PREVIEWS = st.builds(
    lambda name, own: Preview(
        name=name,
        roles=(*NO_EXTRUSION_ROLES, PreviewRole(name, "#123456", True), PreviewRole("b", "#000000")),
        **own,
    ),
    st.text(max_size=8),
    st.tuples(st.integers(0, 12), st.integers(0, 4)).flatmap(lambda size: columns(*size)),
)


@given(PREVIEWS)
def test_decoding_returns_the_moves_within_half_a_step(preview: Preview) -> None:
    data = encode_preview(preview)
    decoded = decode_preview(data)
    spans = np.ptp(preview.points, axis=0)
    for axis, finest in enumerate((0.01, 0.01, 0.001)):
        error = np.abs(decoded.points - preview.points)[:, axis].max()
        if spans[axis] <= 655:
            assert error <= 0.005 + 1e-9
        if spans[axis] <= 65000 * finest:
            assert error <= finest / 2 + 1e-9
        assert error <= max(spans[axis] / 20000, finest)
    for name, step in (
        ("width", 0.005),
        ("height", 0.001),
        ("speed", 0.1),
        ("layer_z", 1e-4),
        ("layer_seconds", 0.01),
    ):
        assert np.allclose(getattr(decoded, name), getattr(preview, name), rtol=0, atol=step * 0.501), name
    for name in ("name", "roles"):
        assert getattr(decoded, name) == getattr(preview, name)
    for name in ("role", "tool", "first", "layer_command"):
        assert np.array_equal(getattr(decoded, name), getattr(preview, name))


@given(PREVIEWS, st.integers(0, 300))
def test_damaged_bytes_are_rejected(preview: Preview, kept: int) -> None:
    data = encode_preview(preview)
    for damaged in (data[: min(kept, len(data) - 1)], data + b"\0", b"x" + data[1:]):
        with pytest.raises(ValueError):  # noqa: PT011 - of json or ours
            decode_preview(damaged)


def test_a_circle_takes_few_bytes() -> None:
    turn = np.linspace(0, 40 * np.pi, 20_001)
    points = np.stack([50 * np.cos(turn), 50 * np.sin(turn), np.full(len(turn), 0.2)], axis=1)
    n_moves = len(turn) - 1
    same = np.full(n_moves, 0.4)
    preview = Preview(
        name="circle",
        points=points,
        role=np.full(n_moves, 4),
        width=same,
        height=same,
        speed=same,
        tool=np.zeros(n_moves),
        roles=(*NO_EXTRUSION_ROLES, PreviewRole("Perimeter", "#123456")),
        first=np.zeros(1),
        layer_z=np.ones(1),
        layer_height=np.ones(1),
        layer_seconds=np.ones(1),
        layer_command=np.zeros(1),
    )
    assert len(gzip.compress(encode_preview(preview))) < 2.2 * n_moves
