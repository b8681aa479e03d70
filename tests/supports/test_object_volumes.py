"""Volumes belong to their object; supports only in enforced places."""

from __future__ import annotations

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.model import Mesh, Volumes
from printer_slicer.placing import join
from printer_slicer.profile import Profile, load_profile
from printer_slicer.values import replace
from tests.parts import box
from tests.supports.shapes import hook, tee

APART = 30.0


def with_supports(**changes: object) -> Profile:
    return load_profile(quality="standard", changes={"support": "columns", **changes})


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> Mesh:
    return Mesh(box(size, at).triangles, "block")


def pair(volumes: Volumes) -> Mesh:
    """Two equal parts side by side, of which the first has volumes."""
    one, other = tee(height=10.0), tee(height=10.0).moved((0.0, APART, 0.0))
    return join([replace(one, volumes=volumes), replace(other, name="other")])


@pytest.mark.parametrize("support", ["off", "columns"])
def test_blockers_apply_to_their_own_object(support: str) -> None:
    everywhere = Volumes(block=block((200.0, 200.0, 30.0), (-100.0, -100.0, 1.0)))
    plate = pair(everywhere)
    profile = with_supports(support=support)
    own, all_objects = (
        ps.overhangs(part, profile) for part in (plate, replace(pair(Volumes()), volumes=everywhere))
    )
    plain = ps.overhangs(pair(Volumes()), profile)

    assert all_objects.area.n_rings == 0
    assert own.area.area().sum() == pytest.approx(plain.area.area().sum() / 2, rel=1e-3)
    assert np.ptp(own.area.xy[:, 1]) < 15 < np.ptp(plain.area.xy[:, 1])


def test_negative_volumes_are_cut_out_of_their_own_object() -> None:
    plate = pair(Volumes(negative=block((200.0, 200.0, 3.0), (-100.0, -100.0, 12.0))))
    area = ps.slice_stages(plate, load_profile(quality="standard")).sections.solid.area()

    assert area[-1] == pytest.approx(area[-15] / 2, rel=1e-3)


def test_volumes_of_objects_move_with_them() -> None:
    plate = pair(Volumes(enforce=block((1.0, 2.0, 3.0), (5.0, 6.0, 7.0))))
    moved = plate.moved((1.0, 2.0, 3.0))
    turned = ps.transform(plate, scale=2.0, rotate=(0.0, 0.0, 90.0))

    for mesh, bounds in ((moved, [[6, 8, 10], [7, 10, 13]]), (turned, [[-16, 10, 14], [-12, 12, 20]])):
        first, second = mesh.objects
        assert second.volumes is None
        assert first.volumes is not None
        assert first.volumes.enforce is not None
        assert first.volumes.enforce.bounds == pytest.approx(np.array(bounds, np.float64))


def test_paths_of_objects_without_volumes_stay_the_same() -> None:
    profile = load_profile(quality="standard")
    enforced = pair(Volumes(enforce=block((50.0, 9.0, 9.0), (-25.0, -4.0, 5.0))))
    one, other = (ps.slice_part(part, profile) for part in (enforced, pair(Volumes())))

    assert (one.xyz == other.xyz).all()
    assert (one.filament == other.filament).all()


def test_only_enforced_places_get_supports() -> None:
    part = tee(height=10.0)
    arm = Volumes(enforce=block((40.0, 40.0, 6.0), (5.0, -20.0, 6.0)))
    half, both, none = (
        ps.slice_stages(part, own, volumes=volumes).supports
        for own, volumes in (
            (with_supports(support_places="enforced"), arm),
            (with_supports(), arm),
            (with_supports(support_places="enforced"), None),
        )
    )

    assert none is None
    assert half is not None
    assert both is not None
    assert half.area.area()[-1] == pytest.approx(both.area.area()[-1] / 2, rel=0.05)


def test_islands_that_are_not_enforced_are_told() -> None:
    found = ps.overhangs(hook(), with_supports(support_places="enforced"))

    assert not found.area.n_rings
    assert found.blocked
    assert all("only in enforced places" in place.reason and place.is_island for place in found.blocked)
