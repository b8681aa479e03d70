"""Bodies that touch, some of them inside out; and symmetric bodies, turned in 32-bit numbers, with one fault."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.healing import repair
from printer_slicer.model import Mesh
from tests.parts import box, cone, sphere


def joined(*meshes: Mesh) -> Mesh:
    return Mesh(np.concatenate([mesh.triangles for mesh in meshes]), "part")


def inside_out(mesh: Mesh) -> Mesh:
    return Mesh(mesh.triangles[:, ::-1], mesh.name)


def at(mesh: Mesh, x: float, y: float, z: float) -> Mesh:
    return Mesh(mesh.triangles - mesh.bounds[0] + np.array([x, y, z]), mesh.name)


@pytest.mark.parametrize(
    "place", [(30.0, 30.0, 0.0), (30.0, 30.0, 30.0), (40.0, 0.0, 0.0)], ids=["edge", "corner", "apart"]
)
@pytest.mark.parametrize("size", [(20.0, 20.0, 30.0), (5.0, 5.0, 5.0), (30.0, 30.0, 30.0)], ids=str)
def test_a_body_that_is_inside_out_is_turned_wherever_it_touches_another(
    place: tuple[float, float, float], size: tuple[float, float, float]
) -> None:
    cube, other = at(box((30, 30, 30)), 0, 0, 0), at(box(size), *place)
    mended, repairs = repair(joined(cube, inside_out(other)))

    assert mended.volume == pytest.approx(cube.volume + other.volume)
    assert [one.kind for one in repairs.done] == ["shells turned outward"]
    assert not repairs.sound


def test_bodies_that_touch_and_face_outward_are_left_alone() -> None:
    whole = joined(at(box((30, 30, 30)), 0, 0, 0), at(box((5, 5, 5)), 30, 30, 30))
    mended, repairs = repair(whole)

    assert mended is whole
    assert repairs.done == ()


def test_one_shell_is_sound() -> None:
    for mesh in (box((9, 9, 5)), sphere(3), cone(5, 9)):
        assert repair(mesh)[1].sound


@pytest.mark.parametrize("fault", ["twice", "missing", "turned"])
@pytest.mark.parametrize("body", ["ball", "cone"])
def test_a_symmetric_body_turned_in_single_numbers_is_repaired_where_it_is_broken(
    body: str, fault: str
) -> None:
    """Rounding leaves mirrored corners a few steps apart; none may be taken for another."""
    mesh = {"ball": sphere(10), "cone": cone(10, 20)}[body]
    middle = (mesh.bounds[0] + mesh.bounds[1]) / 2
    c, s = np.float32(np.cos(np.pi / 2)), np.float32(np.sin(np.pi / 2))
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    turned = ((mesh.triangles - middle).astype(np.float32) @ turn).astype(np.float64)
    whole = Mesh(turned, "part").volume
    broken = {
        "twice": np.concatenate([turned, turned[40:41]]),
        "missing": np.delete(turned, 40, axis=0),
        "turned": np.concatenate([turned[:40], turned[40:41, ::-1], turned[41:]]),
    }[fault]
    mended, repairs = repair(Mesh(broken, "part"))

    assert mended.volume == pytest.approx(whole, rel=1e-6)
    assert repairs.count == 1
