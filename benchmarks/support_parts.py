"""Parts that need supports: made ones, and models turned by fixed angles."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.sizes import printable
from printer_slicer.arrays import Float
from printer_slicer.errors import UsageError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh
from printer_slicer.placing import place
from printer_slicer.profile import Profile
from tests.parts import box, joined, loft
from tests.supports.shapes import bracket, hook, mushroom, round_body, sphere_on_bed, table, tee

__all__ = ["MADE", "TURNED", "arch", "figure", "read_rotation", "support_parts", "turned"]


def arch(span: float = 50.0, depth: float = 16.0, height: float = 36.0) -> Mesh:
    """Two posts with a lintel."""
    posts = [box((10.0, depth, height - 5), (x, 0.0, 0.0)) for x in (0.0, span + 10)]
    return joined([*posts, box((span + 20, depth, 6.0), (0.0, 0.0, height - 6))], "arch")


def figure() -> Mesh:
    """A body with a head, two arms that hang down from the shoulders, and two thin wings that rise behind."""
    body = round_body([(12.0, 0.0), (7.0, 14.0), (5.0, 24.0), (8.0, 40.0), (3.0, 44.0)])
    angle = np.linspace(0, np.pi, 24)
    head = round_body([(6 * np.sin(t), 48 - 6 * np.cos(t)) for t in angle])
    parts = [body, head]
    for way in (-1.0, 1.0):
        arm = _limb((4.0, 0.0, 38.0), (24.0, -4.0, 27.0), 2.5)
        hand = round_body([(3.5 * np.sin(t), 26 - 3.5 * np.cos(t)) for t in angle], at=(24.0, -4.0))
        wing = Mesh(loft([_wing(5.0), _wing(6.2)], [0.0, 1.6]), "wing")
        upright = _mapped(wing, np.array([(1.0, 0, 0), (0, 0, 1.0), (0, 1.0, 0)]), (0.0, 4.0, 30.0))
        parts += [_mirrored(one, way) for one in (arm, hand, upright)]
    return joined(parts, "figure")


def _wing(lean: float) -> Float:
    """The outline of a wing, as x and height."""
    corners: Float = np.array([(2.0, 0.0), (30.0, 10.0 + lean), (34.0, 16.0 + lean), (2.0, 9.0)])
    return corners


def _limb(start: Sequence[float], end: Sequence[float], radius: float, sides: int = 24) -> Mesh:
    """A straight cylinder between two points."""
    low, high = np.asarray(start, np.float64), np.asarray(end, np.float64)
    along = (high - low) / np.linalg.norm(high - low)
    across = np.cross(along, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across)
    frame = np.stack([across, np.cross(along, across), along])
    turn = 2 * np.pi * np.arange(sides) / sides
    circle = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    length = float(np.linalg.norm(high - low))
    straight = loft([circle, circle], [0.0, length])
    return Mesh(straight @ frame + low, "limb")


def _mapped(mesh: Mesh, matrix: Float, shift: Sequence[float]) -> Mesh:
    """Return the mesh under a linear map, with its facets facing outward."""
    triangles = mesh.triangles @ matrix.T + np.asarray(shift)
    return Mesh(triangles[:, ::-1] if np.linalg.det(matrix) < 0 else triangles, mesh.name)


def _mirrored(mesh: Mesh, way: float) -> Mesh:
    return _mapped(mesh, np.diag([way, 1.0, 1.0]), (0.0, 0.0, 0.0))


def turned(mesh: Mesh, degrees: Sequence[float]) -> Mesh:
    """Return the mesh turned about x, then y, then z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.deg2rad(degrees)):
        one = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one[i, i] = one[j, j] = np.cos(angle)
        one[i, j], one[j, i] = -np.sin(angle), np.sin(angle)
        matrix = one @ matrix
    return Mesh(mesh.triangles @ matrix.T, mesh.name)


MADE: Final[Mapping[str, Callable[[], Mesh]]] = {
    "tee": tee,
    "hook": hook,
    "sphere": sphere_on_bed,
    "mushroom": mushroom,
    "arch": arch,
    "bracket": bracket,
    "table": table,
    "figure": figure,
}

TURNED: Final[Mapping[str, tuple[str, tuple[float, float, float]]]] = {
    "benchy": ("benchy", (0, 0, 0)),
    "benchy_60": ("benchy", (60, 0, 0)),
    "bp_case_120": ("bp_case", (120, 0, 0)),
    "fandisk_35": ("fandisk", (35, 20, 0)),
    "idler_riser_90": ("idler_riser", (0, 90, 30)),
    "octagonal_pocket_100": ("octagonal_pocket", (100, 0, 0)),
    "torus_50": ("torus", (50, 0, 0)),
}
"""The model of each turned part, and its rotation about x, y and z, degrees."""

_ROTATION: Final = re.compile(r"([xyz])(-?\d+(?:\.\d+)?)")


def support_parts(models: Path | None, names: Sequence[str], profile: Profile) -> Iterator[Mesh]:
    """Return the named parts, or all that can be made, repaired and placed in the middle of the bed.

    Args:
        models: folder with the models of `TURNED`; None leaves these parts out.
        names: of parts; empty: all. `NAME@x60z30` is the model NAME of the folder, turned by 60 degrees about x, then
            by 30 degrees about z.
        profile: its printer has the bed.

    Raises:
        UsageError: a name is neither that of a part nor that of a turned model.
    """
    for name, make in MADE.items():
        if not names or name in names:
            yield _placed(make(), name, profile)
    files = {path.stem: path for path in sorted(models.iterdir())} if models else {}
    for name, (model, degrees) in _find_turned(files, names).items():
        mesh, _ = printable(load_mesh(files[model]))
        yield _placed(turned(mesh, degrees), name, profile)


def _find_turned(
    files: Mapping[str, Path], names: Sequence[str]
) -> dict[str, tuple[str, tuple[float, float, float]]]:
    """Return model and rotation of the named parts, or of all known ones, for which there are files."""
    known = {name: one for name, one in TURNED.items() if one[0] in files}
    if not names:
        return known
    asked = {
        name: known[name] if name in known else read_rotation(name) for name in names if name not in MADE
    }
    if missing := [model for model, _ in asked.values() if model not in files]:
        raise UsageError(f"no model {', '.join(missing)}", remedy=f"Models: {', '.join(files)}")
    return asked


def read_rotation(name: str) -> tuple[str, tuple[float, float, float]]:
    """Return the model and its rotation about x, y and z, degrees, of a name such as `benchy@x60z30`.

    Raises:
        UsageError: the name has another form.
    """
    model, _, text = name.partition("@")
    angles = dict(_ROTATION.findall(text))
    if not text or "".join(f"{axis}{angles[axis]}" for axis in "xyz" if axis in angles) != text:
        raise UsageError(
            f"no part {name}", remedy=f"Parts: {', '.join([*MADE, *TURNED])}, or MODEL@x60y20z30"
        )
    x, y, z = (float(angles.get(axis, 0)) for axis in "xyz")
    return model, (x, y, z)


def _placed(mesh: Mesh, name: str, profile: Profile) -> Mesh:
    return Mesh(place(repair(mesh)[0], profile.printer).triangles, name)
