"""Encode previews as bytes for viewers, and decode them.

The file, with little-endian numbers and K moves:

    8 bytes      "PREVIEW1"
    4 bytes      length of the header
    header       JSON in UTF-8: `name`; `moves`, K; `origin` and `step` of x, y and z, mm; `start`, the first point in
                 steps from the origin; `roles`, each with `name`, `colour`, `outer` and `priming`; `layers` with
                 the columns `first`, `z`, `height`, `seconds` and `command`
    12 K bytes   the columns x, y, z, width, height and speed, 2 bytes a move
    2 K bytes    the columns role and tool, 1 byte a move

A column of 2 bytes holds the differences between neighbours, which start from `start` for x, y and z and from 0 for the
others. They are taken modulo 65536 as signed numbers d, written as 2 d if d >= 0 and as -2 d - 1 if not, first the low
bytes of all moves, then the high bytes. So most bytes are 0, and the file is small after gzip. The steps of the other
columns are fixed: 0.005 mm for width, 0.001 mm for height, 0.1 mm/s for speed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.preview.columns import Preview, PreviewRole

__all__ = ["decode_preview", "encode_preview"]

_MAGIC: Final = b"PREVIEW1"
_MOST: Final = 65535
_WIDTH_STEP, _HEIGHT_STEP, _SPEED_STEP = 0.005, 0.001, 0.1  # mm, mm, mm/s
_STEPS_XY: Final = (0.01, 0.02, 0.05, 0.1, 1.0, 10.0, 1e3, 1e5)  # mm; the finest that spans the moves is used
_STEPS_Z: Final = (0.001, *_STEPS_XY)
_BYTES_PER_MOVE: Final = 14


def encode_preview(preview: Preview) -> bytes:
    """Return the bytes of a preview; positions are rounded to 0.01 mm if the moves span at most 655 mm.

    Raises:
        ValueError: positions are not finite, or the moves span more than a machine can.
    """
    step = np.array(
        [
            _choose_step(column, _STEPS_XY if axis < 2 else _STEPS_Z)
            for axis, column in enumerate(preview.points.T)
        ]
    )
    origin = np.round(np.floor(preview.points.min(axis=0) / step) * step, 4)
    points = np.clip(np.rint((preview.points - origin) / step), 0, _MOST).astype(np.int64)
    header = _make_header(preview) | {
        "origin": origin.tolist(),
        "step": step.tolist(),
        "start": points[0].tolist(),
    }
    encoded = json.dumps(header, separators=(",", ":")).encode()
    columns = [_encode_column(np.diff(column)) for column in points.T]
    for values, unit in (
        (preview.width, _WIDTH_STEP),
        (preview.height, _HEIGHT_STEP),
        (preview.speed, _SPEED_STEP),
    ):
        steps = np.clip(np.rint(values / unit), 0, _MOST).astype(np.int64)
        columns.append(_encode_column(np.diff(steps, prepend=0)))
    columns += [np.minimum(column, 255).astype(np.uint8).tobytes() for column in (preview.role, preview.tool)]
    return b"".join([_MAGIC, len(encoded).to_bytes(4, "little"), encoded, *columns])


def decode_preview(data: bytes) -> Preview:
    """Return the preview that bytes of `encode_preview` hold.

    Raises:
        ValueError: the bytes are not those of a preview.
    """
    if data[:8] != _MAGIC:
        raise ValueError("not a preview")
    begin = 12 + int.from_bytes(data[8:12], "little")
    header = json.loads(data[12:begin])
    n_moves = int(header["moves"])
    if len(data) != begin + _BYTES_PER_MOVE * n_moves:
        raise ValueError("the preview is incomplete")
    table = np.frombuffer(data, np.uint8, offset=begin)
    wide = table[: 12 * n_moves].reshape(6, 2, n_moves)
    starts = [*header["start"], 0, 0, 0]
    steps = np.stack([_decode_column(planes, start) for planes, start in zip(wide, starts, strict=True)])
    role, tool = table[12 * n_moves :].reshape(2, n_moves)
    points = np.concatenate([np.array([header["start"]]), steps[:3].T]) * header["step"] + header["origin"]
    return Preview(
        name=header["name"],
        points=points,
        role=role.astype(np.int64),
        width=steps[3] * _WIDTH_STEP,
        height=steps[4] * _HEIGHT_STEP,
        speed=steps[5] * _SPEED_STEP,
        tool=tool.astype(np.int64),
        roles=tuple(
            PreviewRole(one["name"], one["colour"], one["outer"], one["priming"]) for one in header["roles"]
        ),
        **_read_layers(header["layers"]),
    )


def _make_header(preview: Preview) -> dict[str, Any]:
    """Return the part of the header that does not depend on the rounding of positions."""
    return {
        "name": preview.name,
        "moves": preview.n_moves,
        "roles": [
            {
                "name": role.name,
                "colour": role.colour,
                "outer": role.is_outer,
                "priming": role.is_priming,
            }
            for role in preview.roles
        ],
        "layers": {
            "first": preview.first.tolist(),
            "z": np.round(preview.layer_z, 4).tolist(),
            "height": np.round(preview.layer_height, 4).tolist(),
            "seconds": np.round(preview.layer_seconds, 2).tolist(),
            "command": preview.layer_command.tolist(),
        },
    }


def _read_layers(layers: Mapping[str, Any]) -> dict[str, Any]:
    """Return the columns of layers as attributes of `Preview`."""
    return {
        "first": np.array(layers["first"], np.int64),
        "layer_z": np.array(layers["z"], np.float64),
        "layer_height": np.array(layers["height"], np.float64),
        "layer_seconds": np.array(layers["seconds"], np.float64),
        "layer_command": np.array(layers["command"], np.int64),
    }


def _choose_step(column: Float, steps: tuple[float, ...]) -> float:
    """Return the finest step, mm, that spans the values of a column (n,), mm, with 16 bits.

    Raises:
        ValueError: no step does.
    """
    span = float(np.ptp(column))
    found = next((step for step in steps if span <= step * (_MOST - 1)), None)
    if found is None:
        raise ValueError("the moves span more than any machine")
    return found


def _encode_column(difference: Int) -> bytes:
    """Return the low bytes, then the high bytes, of differences (K,)."""
    signed = difference.astype(np.int16).astype(np.int64)  # modulo 65536
    folded = np.where(signed >= 0, 2 * signed, -2 * signed - 1).astype(np.uint16)
    return (folded & 255).astype(np.uint8).tobytes() + (folded >> 8).astype(np.uint8).tobytes()


def _decode_column(planes: np.ndarray[Any, np.dtype[np.uint8]], start: int) -> Int:
    """Return the values (K,) in steps whose differences have these low and high bytes (2, K)."""
    folded = planes[0].astype(np.int64) + 256 * planes[1].astype(np.int64)
    signed = np.where(folded & 1, -(folded + 1) // 2, folded // 2)
    return np.asarray((start + np.cumsum(signed)) % 65536)
