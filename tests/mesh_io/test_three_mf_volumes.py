"""Support enforcers and blockers, negative volumes and painted facets in 3MF files, as other slicers write them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tiny_files import BOX, CORNERS, FACES, item, mesh_xml, model_xml, three_mf, write

from printer_slicer.arrays import Float
from printer_slicer.errors import MeshError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import Model, load_model
from printer_slicer.model import Mesh, Volumes
from printer_slicer.placing import join, place, transform
from printer_slicer.plates import arrange
from printer_slicer.profile import Printer, load_profile

MOVED = (1, 0, 0, 0, 1, 0, 0, 0, 1, 10, 20, 30)
MIRRORED = (-1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0)
PRUSA = ' xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06"'
TYPES = ("ModelPart", "SupportEnforcer", "ModelPart", "SupportBlocker", "NegativeVolume", "ParameterModifier")


def prusa_config(types: Sequence[str], number: int = 1) -> str:
    """The volumes of an object of 12 facets each, as PrusaSlicer 2.5 lists them."""
    volumes = "".join(
        f'  <volume firstid="{12 * k}" lastid="{12 * k + 11}">\n'
        f'   <metadata type="volume" key="name" value="volume {k}"/>\n'
        + ('   <metadata type="volume" key="modifier" value="1"/>\n' if kind == "ParameterModifier" else "")
        + f'   <metadata type="volume" key="volume_type" value="{kind}"/>\n'
        '   <metadata type="volume" key="matrix" value="1 0 0 17.5 0 1 0 0 0 0 1 20 0 0 0 1"/>\n'
        '   <mesh edges_fixed="0" degenerate_facets="0" facets_removed="0" facets_reversed="0"/>\n  </volume>\n'
        for k, kind in enumerate(types)
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<config>\n <object id="{number}" instances_count="1">\n'
        f'  <metadata type="object" key="name" value="tee"/>\n{volumes} </object>\n</config>'
    )


def shift(points: Float, x: float, y: float = 0.0) -> Float:
    return points + np.array([x, y, 0.0])


def boxes(count: int) -> str:
    """Boxes in one mesh; box k begins at x = 10 k."""
    corners = np.concatenate([shift(CORNERS, 10 * k) for k in range(count)])
    return mesh_xml(corners, np.concatenate([FACES + 8 * k for k in range(count)]))


def read(folder: Path, model: str, name: str = "", config: str = "") -> Model:
    more = {f"Metadata/{name}": config} if name else {}
    return load_model(write(folder, three_mf(model, more), "part.3mf"))


def volumes_of(model: Model) -> Volumes:
    assert model.mesh.all_volumes
    return model.mesh.all_volumes


def box_at(mesh: Mesh | None, x: float) -> bool:
    return mesh is not None and np.array_equal(mesh.triangles, shift(BOX, x))


def test_prusaslicer_lists_volumes_as_ranges_of_facets(tmp_path: Path) -> None:
    text = model_xml({1: boxes(6)}, item(1))
    model = read(tmp_path, text, "Slic3r_PE_model.config", prusa_config(TYPES))
    volumes = volumes_of(model)

    assert np.array_equal(model.mesh.triangles, np.concatenate([BOX, shift(BOX, 20)]))
    assert [one.name for one in model.mesh.objects] == ["tee"]
    assert box_at(volumes.enforce, 10)
    assert box_at(volumes.block, 30)
    assert box_at(volumes.negative, 40)
    (modifier,) = volumes.modifiers
    assert modifier.name == "tee/volume 5"
    assert box_at(modifier, 50)
    assert model.notes == ()


@pytest.mark.parametrize("name", ["Metadata/model_settings.config", "metadata/Model_Settings.config"])
def test_orcaslicer_lists_volumes_as_components(name: str, tmp_path: Path) -> None:
    kinds = ("normal_part", "support_enforcer", "support_blocker", "negative_part")
    objects = {k + 1: mesh_xml(shift(CORNERS, 10 * k)) for k in range(4)}
    inner = "".join(f'<component p:path="/3D/Objects/a.model" objectid="{k + 1}"/>' for k in range(4))
    text = model_xml(
        {9: f"<components>{inner}</components>"}, item(9) + item(9, (1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 50, 0))
    )
    parts = "".join(
        f'<part id="{k + 1}" subtype="{kind}"><metadata key="name" value="{k}"/></part>'
        for k, kind in enumerate(kinds)
    )
    config = f'<config><object id="9"><metadata key="name" value="Box"/>{parts}</object></config>'
    model = load_model(
        write(
            tmp_path,
            three_mf(text, {name: config, "3D/Objects/a.model": model_xml(objects, "")}),
            "part.3mf",
        )
    )
    volumes = volumes_of(model)

    assert model.notes == ()
    assert model.mesh.n_facets == 24
    for mesh, x in ((volumes.enforce, 10), (volumes.block, 20), (volumes.negative, 30)):
        assert mesh is not None
        assert np.array_equal(mesh.triangles, np.concatenate([shift(BOX, x), shift(BOX, x, 50)]))


def test_volumes_are_placed_as_their_object(tmp_path: Path) -> None:
    config = prusa_config(["ModelPart", "SupportEnforcer"])
    text = model_xml({1: boxes(2)}, item(1, MIRRORED) + item(1, MOVED), unit="centimeter")
    mesh = volumes_of(read(tmp_path, text, "Slic3r_PE_model.config", config)).enforce

    assert mesh is not None
    assert mesh.bounds.tolist() == [[-120, 0, 0], [220, 230, 340]]
    assert mesh.volume == pytest.approx(2 * 24e3)


def test_volumes_of_other_objects_are_not_mixed_up(tmp_path: Path) -> None:
    text = model_xml({1: boxes(2), 2: boxes(2)}, item(1) + item(2, MOVED))
    model = read(tmp_path, text, "Slic3r_PE_model.config", prusa_config(["SupportBlocker", "ModelPart"], 2))

    assert [(one.name, one.count) for one in model.mesh.objects] == [("part", 24), ("tee", 12)]
    assert box_at(Mesh(volumes_of(model).block.triangles - MOVED[9:]), 0)  # type: ignore[union-attr]


def test_a_file_without_volumes_has_none(tmp_path: Path) -> None:
    model = read(
        tmp_path, model_xml({1: boxes(1)}, item(1)), "Slic3r_PE_model.config", prusa_config(["ModelPart"])
    )

    assert model.mesh.volumes is None
    assert model.notes == ()


def test_a_volume_without_finite_coordinates_is_refused(tmp_path: Path) -> None:
    text = model_xml({1: boxes(2)}, item(1)).replace('x="12.0"', 'x="1e300"')

    with pytest.raises(MeshError, match="a support enforcer has a coordinate that is too large"):
        read(tmp_path, text, "Slic3r_PE_model.config", prusa_config(["ModelPart", "SupportEnforcer"]))


# Paint


def paint(mesh: str, digits: dict[int, str], attribute: str = "slic3rpe:custom_supports") -> str:
    head, *facets = mesh.split("<triangle ")
    for facet, text in digits.items():
        facets[facet] = facets[facet].replace("/>", f' {attribute}="{text}"/>')
    return "<triangle ".join([head, *facets])


@pytest.mark.parametrize("attribute", ["slic3rpe:custom_supports", "paint_supports"])
def test_painted_facets_are_placed_as_their_object(attribute: str, tmp_path: Path) -> None:
    mesh = paint(boxes(1), {1: "4", 3: "8", 5: "481"}, attribute)
    model = read(tmp_path, model_xml({1: mesh}, item(1) + item(1, MOVED), more=PRUSA))
    volumes = volumes_of(model)
    a, b, c = BOX[5]

    pieces = np.array([BOX[1], [a, b, (b + c) / 2]])
    assert np.allclose(
        _sorted(volumes.enforced_facets), _sorted(np.concatenate([pieces, pieces + MOVED[9:]]))
    )
    pieces = np.array([BOX[3], [(b + c) / 2, c, a]])
    assert np.allclose(_sorted(volumes.blocked_facets), _sorted(np.concatenate([pieces, pieces + MOVED[9:]])))
    assert model.notes == ()


def _sorted(triangles: Float) -> Float:
    rows = triangles.reshape(-1, 9)
    return rows[np.lexsort(rows.T)]


def test_paint_follows_the_facets_of_its_volume(tmp_path: Path) -> None:
    """The first volume is not printed, so that the indices of the part's facets change; its own paint has no effect."""
    mesh = paint(boxes(2), {2: "8", 15: "4"})
    config = prusa_config(["SupportEnforcer", "ModelPart"])
    volumes = volumes_of(
        read(tmp_path, model_xml({1: mesh}, item(1), more=PRUSA), "Slic3r_PE_model.config", config)
    )

    assert np.array_equal(volumes.enforced_facets, shift(BOX[3:4], 10))
    assert len(volumes.blocked_facets) == 0


def test_damaged_paint_is_refused_with_the_number_of_the_triangle(tmp_path: Path) -> None:
    mesh = paint(boxes(1), {1: "4", 7: "83"})

    with pytest.raises(MeshError, match="object 1: triangle 8 has paint that ends early: '83'"):
        read(tmp_path, model_xml({1: mesh}, item(1), more=PRUSA))


@pytest.mark.parametrize("key", ["slic3rpe", "BambuStudio"])
def test_paint_of_an_unknown_version_is_refused(key: str, tmp_path: Path) -> None:
    def text(version: int, mesh: str) -> str:
        metadata = f'<metadata name="{key}:FdmSupportsPaintingVersion">{version}</metadata><resources>'
        return model_xml({1: mesh}, item(1), more=PRUSA).replace("<resources>", metadata)

    assert len(volumes_of(read(tmp_path, text(1, paint(boxes(1), {1: "4"})))).enforced_facets) == 1
    assert read(tmp_path, text(2, boxes(1))).mesh.volumes is None
    with pytest.raises(MeshError, match="painted for supports in version 2, which is unknown") as caught:
        read(tmp_path, text(2, paint(boxes(1), {1: "4"})))
    assert caught.value.remedy


# Volumes go where their mesh goes


def _mesh_with_volumes() -> Mesh:
    """A box whose volumes and painted facets are all like it."""
    return Mesh(BOX, "box", volumes=Volumes(Mesh(BOX), Mesh(BOX), Mesh(BOX), BOX, BOX))


def _all_triangles(mesh: Mesh) -> list[Float]:
    volumes = mesh.all_volumes
    assert volumes
    meshes = [one.triangles for one in (volumes.enforce, volumes.block, volumes.negative) if one]
    assert len(meshes) == 3
    return [*meshes, volumes.enforced_facets, volumes.blocked_facets]


def test_volumes_go_where_their_mesh_goes() -> None:
    mesh = _mesh_with_volumes()
    printer = Printer(name="test", bed_x=100, bed_y=100, bed_z=100)
    for changed in (
        mesh.moved((1, 2, 3)),
        transform(mesh, scale=(1, 2, 3), rotate=(30, 0, 90)),
        place(mesh.moved((0.1, 0.2, 0.3)), printer),
        arrange([mesh] * 3, load_profile("marlin_220"))[0],
        join([mesh, mesh.moved((5, 0, 0))]),
    ):
        for triangles in _all_triangles(changed):
            assert np.array_equal(triangles, changed.triangles)


def test_volumes_stay_when_the_mesh_is_repaired() -> None:
    mesh = _mesh_with_volumes()
    repaired, repairs = repair(Mesh(mesh.triangles[1:], "box", volumes=mesh.volumes))

    assert repairs.count
    for triangles in _all_triangles(repaired):
        assert np.array_equal(triangles, BOX)


def test_joining_keeps_what_only_one_mesh_has() -> None:
    other = Mesh(BOX + 20, volumes=Volumes(block=Mesh(BOX + 20)))
    volumes = join([Mesh(BOX, volumes=Volumes(enforce=Mesh(BOX))), Mesh(BOX + 10), other]).all_volumes

    assert volumes
    assert np.array_equal(volumes.enforce.triangles, BOX)  # type: ignore[union-attr]
    assert np.array_equal(volumes.block.triangles, BOX + 20)  # type: ignore[union-attr]
    assert volumes.negative is None
    assert join([Mesh(BOX), Mesh(BOX + 10)]).all_volumes is None
