"""3MF as the specification has it: units, items, components, mirrored copies, several model files, what slicers add."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from tiny_files import BOX, CORE, CORNERS, FACES, item, mesh_xml, model_xml, three_mf, write, zipped

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import UNITS, Model, load_mesh, load_model

MOVED = (1, 0, 0, 0, 1, 0, 0, 0, 1, 10, 20, 30)
QUARTER = (0, 1, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0)
"""About z, counter-clockwise."""
MIRRORED = (-1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0)


def read(
    folder: Path, model: str, more: Mapping[str, str | bytes] | None = None, units: str | None = None
) -> Model:
    return load_model(write(folder, three_mf(model, more), "part.3mf"), units=units)


def fault(folder: Path, content: bytes) -> str:
    path = write(folder, content, "part.3mf")
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    return str(caught.value)


def component(number: int, matrix: tuple[float, ...] = (), path: str = "") -> str:
    transform = f' transform="{" ".join(map(str, matrix))}"' if matrix else ""
    place = f' p:path="{path}"' if path else ""
    return f'<component objectid="{number}"{transform}{place}/>'


def group(*components: str) -> str:
    return f"<components>{''.join(components)}</components>"


def test_an_object_is_where_the_file_has_it(tmp_path: Path) -> None:
    model = read(tmp_path, model_xml({1: mesh_xml()}, item(1)))

    assert np.array_equal(model.mesh.triangles, BOX)
    assert (model.kind, model.unit, model.notes) == ("3mf", "mm", ())


def test_the_unit_of_the_person_wins_over_that_of_the_file(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1), unit="inch")

    assert read(tmp_path, text).mesh.size.tolist() == pytest.approx([50.8, 76.2, 101.6])
    for unit, mm in UNITS.items():
        assert read(tmp_path, text, units=unit).mesh.size.tolist() == pytest.approx([2 * mm, 3 * mm, 4 * mm])


def test_a_file_without_a_unit_is_in_mm(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1)).replace(' unit="millimeter"', "")

    assert np.array_equal(read(tmp_path, text).mesh.triangles, BOX)


def test_transforms_are_applied_from_the_inside_out(tmp_path: Path) -> None:
    text = model_xml(
        {1: mesh_xml(), 2: group(component(1, MOVED)), 3: group(component(2, QUARTER))}, item(3, MOVED)
    )

    # (0..2, 0..3, 0..4) moved: (10..12, 20..23, 30..34); turned: (-23..-20, 10..12, 30..34); moved again.
    assert read(tmp_path, text).mesh.bounds.tolist() == [[-13, 30, 60], [-10, 32, 64]]


def test_the_unit_applies_to_transforms_too(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1, MOVED), unit="centimeter")

    assert read(tmp_path, text).mesh.bounds.tolist() == [[100, 200, 300], [120, 230, 340]]


@pytest.mark.parametrize("where", ["item", "component", "both"])
def test_mirrored_copies_keep_their_outside_out(tmp_path: Path, where: str) -> None:
    inner, outer = (MIRRORED if where != "item" else ()), (MIRRORED if where != "component" else ())
    model = read(tmp_path, model_xml({1: mesh_xml(), 2: group(component(1, inner))}, item(2, outer)))

    assert model.mesh.volume == pytest.approx(24.0)
    assert model.mesh.bounds[:, 0].tolist() == ([0, 2] if where == "both" else [-2, 0])


def test_a_plain_and_a_mirrored_copy_add_up(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1) + item(1, (-1, 0, 0, 0, 1, 0, 0, 0, 1, -5, 0, 0)))

    assert read(tmp_path, text).mesh.volume == pytest.approx(48.0)


def test_an_object_may_have_facets_and_components(tmp_path: Path) -> None:
    """The specification wants one or the other; files have both, and nothing should be lost."""
    text = model_xml({1: mesh_xml(), 2: mesh_xml(CORNERS + 50) + group(component(1))}, item(2))

    assert read(tmp_path, text).mesh.n_facets == 24


def test_what_is_not_to_be_printed_is_left_out_and_told(tmp_path: Path) -> None:
    model = read(tmp_path, model_xml({1: mesh_xml()}, item(1) + item(1, MOVED, ' printable="0"')))

    assert model.mesh.n_facets == 12
    assert model.notes == ("1 item is marked as not printable and left out",)


def test_a_file_with_nothing_to_print_is_refused(tmp_path: Path) -> None:
    assert "no printable object" in fault(
        tmp_path, three_mf(model_xml({1: mesh_xml()}, item(1, (), ' printable="0"')))
    )


@pytest.mark.parametrize("kind", ["support", "solidsupport", "surface", "other"])
def test_objects_that_are_no_model_are_left_out_and_told(tmp_path: Path, kind: str) -> None:
    text = model_xml({1: mesh_xml(), 2: mesh_xml()}, item(1) + item(2, MOVED))
    model = read(tmp_path, text.replace('<object id="2">', f'<object id="2" type="{kind}">'))

    assert model.mesh.n_facets == 12
    assert model.notes == (f"object 2 is of type '{kind}' and left out",)


def test_items_may_be_objects_of_another_model_file(tmp_path: Path) -> None:
    """Also where the first file has an object of the same number, and where the other one groups its own."""
    there = model_xml({1: mesh_xml(CORNERS + 50), 2: group(component(1, MOVED))}, "")
    text = model_xml(
        {1: mesh_xml()},
        item(1) + item(1, MOVED, ' p:path="/3D/o.model"') + item(2, (), ' p:path="3D/O.model"'),
    )
    triangles = read(tmp_path, text, {"3D/o.model": there}).mesh.triangles

    assert np.array_equal(triangles[:12], BOX)
    assert np.array_equal(triangles[12:24], BOX + 50 + MOVED[9:])
    assert np.array_equal(triangles[24:], triangles[12:24])


def test_a_first_model_file_may_hold_nothing_but_items(tmp_path: Path) -> None:
    text = model_xml({}, item(1, (), ' p:path="/3D/o.model"'))
    model = read(tmp_path, text, {"3D/o.model": model_xml({1: mesh_xml()}, "")})

    assert np.array_equal(model.mesh.triangles, BOX)
    assert "the archive does not contain '3d/o.model'" in fault(tmp_path, three_mf(text))


def test_metadata_colours_and_unknown_elements_are_ignored(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1))
    text = text.replace(
        "<resources>", '<metadata name="Title">x &amp; y</metadata><resources><m:texture xmlns:m="u"/>'
    )
    text = text.replace('v3="1"/>', 'v3="1" pid="4" p1="0"/>', 1).replace(
        "<mesh>", '<mesh><odd vertex="no"/>'
    )

    assert np.array_equal(read(tmp_path, text).mesh.triangles, BOX)


def test_attributes_may_come_in_any_order(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml()}, item(1))
    text = text.replace('<vertex x="0.0" y="0.0" z="0.0"/>', '<vertex z="0.0" y="0.0" x="0.0"/>')
    text = text.replace('<vertex x="2.0" y="0.0" z="0.0"/>', '<vertex z="0.0" x="2.0" y="0.0" w="1"/>')
    text = text.replace('<triangle v1="0" v2="2" v3="1"/>', '<triangle v3="1" pid="3" v2="2" v1="0"/>')

    assert np.array_equal(read(tmp_path, text).mesh.triangles, BOX)


def test_several_model_files_of_one_archive_are_joined(tmp_path: Path) -> None:
    """As the production extension has it, and as slicers write large plates."""
    text = model_xml(
        {8: group(component(1, MOVED, "/3D/Objects/one.model"), component(7, (), "/3D/Objects/two.model"))},
        item(8),
    )
    more = {
        "3D/Objects/one.model": model_xml({1: mesh_xml()}, ""),
        "3D/Objects/two.model": model_xml({7: mesh_xml()}, ""),
    }
    mesh = read(tmp_path, text, more).mesh

    assert mesh.n_facets == 24
    assert mesh.bounds.tolist() == [[0, 0, 0], [12, 23, 34]]


def test_objects_of_several_model_files_may_have_the_same_number(tmp_path: Path) -> None:
    text = model_xml({1: group(component(1, MOVED, "/3D/other.model"))}, item(1))
    mesh = read(tmp_path, text, {"3D/other.model": model_xml({1: mesh_xml()}, "")}).mesh

    assert mesh.bounds.tolist() == [[10, 20, 30], [12, 23, 34]]


def test_the_relations_of_the_archive_say_which_model_file_counts(tmp_path: Path) -> None:
    relations = (
        '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="1" '
        'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/odd/Name.Model"/></Relationships>'
    )
    members = {
        "_rels/.rels": relations,
        "odd/name.model": model_xml({1: mesh_xml()}, item(1)),
        "3D/3dmodel.model": model_xml({1: mesh_xml(2 * CORNERS)}, item(1)),
    }

    assert load_mesh(write(tmp_path, zipped(members), "part.3mf")).volume == pytest.approx(24.0)


def test_a_volume_that_only_changes_settings_is_not_printed_prusa(tmp_path: Path) -> None:
    faces = np.concatenate([FACES, FACES + 8])
    text = model_xml({1: mesh_xml(np.concatenate([CORNERS, 3 * CORNERS]), faces)}, item(1))
    config = (
        '<config><object id="1" instances_count="1"><volume firstid="0" lastid="11">'
        '<metadata type="volume" key="volume_type" value="ModelPart"/></volume><volume firstid="12" lastid="23">'
        '<metadata type="volume" key="modifier" value="1"/><metadata type="volume" key="name" value="Softer"/>'
        '<metadata type="volume" key="volume_type" value="ParameterModifier"/></volume></object></config>'
    )
    model = read(tmp_path, text, {"Metadata/Slic3r_PE_model.config": config})

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == ()
    assert model.mesh.volumes is not None
    assert [one.name for one in model.mesh.volumes.modifiers] == ["/Softer"]


def test_copies_of_prusaslicer_have_the_name_and_the_modifiers_of_their_original(tmp_path: Path) -> None:
    faces = np.concatenate([FACES, FACES + 8])
    objects = {
        1: mesh_xml(np.concatenate([CORNERS, 3 * CORNERS]), faces),
        2: group(component(1)),
        3: group(component(1, QUARTER)),
    }
    text = model_xml(objects, item(1) + item(2, MOVED) + item(3, MOVED))
    config = (
        '<config><object id="1" instances_count="3"><metadata type="object" key="name" value="lid"/>'
        '<volume firstid="0" lastid="11"><metadata type="volume" key="volume_type" value="ModelPart"/></volume>'
        '<volume firstid="12" lastid="23"><metadata type="volume" key="name" value="Softer"/>'
        '<metadata type="volume" key="volume_type" value="ParameterModifier"/></volume></object></config>'
    )
    model = read(tmp_path, text, {"Metadata/Slic3r_PE_model.config": config})

    assert [one.name for one in model.mesh.objects] == ["lid", "lid", "lid"]
    names = [[inner.name for inner in one.volumes.modifiers] for one in model.mesh.objects if one.volumes]
    assert names == [["lid/Softer"]] * 3
    assert model.mesh.triangles[12:24] == pytest.approx(np.add(BOX, [10, 20, 30]))
    turned = BOX @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    assert model.mesh.triangles[24:] == pytest.approx(np.add(turned, [10, 20, 30]))


def test_a_modifier_of_old_slicers_is_not_printed(tmp_path: Path) -> None:
    text = model_xml(
        {1: mesh_xml(np.concatenate([CORNERS, 3 * CORNERS]), np.concatenate([FACES, FACES + 8]))}, item(1)
    )
    config = (
        '<config><object id="1"><volume firstid="0" lastid="11"/><volume firstid="12" lastid="23">'
        '<metadata type="volume" key="modifier" value="1"/></volume></object></config>'
    )
    model = read(tmp_path, text, {"Metadata/Slic3r_PE_model.config": config})

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.mesh.volumes is not None
    assert [one.name for one in model.mesh.volumes.modifiers] == ["/modifier"]


def test_volumes_of_unknown_types_are_left_out(tmp_path: Path) -> None:
    text = model_xml(
        {1: mesh_xml(np.concatenate([CORNERS, 3 * CORNERS]), np.concatenate([FACES, FACES + 8]))}, item(1)
    )
    config = (
        '<config><object id="1"><volume firstid="0" lastid="11"/><volume firstid="12" lastid="23">'
        '<metadata type="volume" key="name" value="x"/><metadata type="volume" key="volume_type" value="Glue"/>'
        "</volume></object></config>"
    )
    model = read(tmp_path, text, {"Metadata/Slic3r_PE_model.config": config})

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == ("1 volume is of an unknown type and left out: 'x' (Glue)",)


def test_a_volume_that_only_changes_settings_is_not_printed_bambu(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml(), 2: mesh_xml(3 * CORNERS), 3: group(component(1), component(2))}, item(3))
    parts = (
        '<part id="1" subtype="normal_part"><metadata key="name" value="Box"/></part>'
        '<part id="2" subtype="modifier_part"><metadata key="name" value="Softer"/></part>'
    )
    config = f'<config><object id="3">{parts}</object></config>'
    model = read(tmp_path, text, {"Metadata/model_settings.config": config})

    assert np.array_equal(model.mesh.triangles, BOX)
    assert model.notes == ()


def painted(mesh: str, **counts: int) -> str:
    """The mesh with so many facets painted for each attribute, the first ones."""
    head, *facets = mesh.split("<triangle ")
    for name, count in counts.items():
        for k in range(count):
            facets[k] = f'{name.replace("__", ":")}="4" {facets[k]}'
    return "<triangle ".join([head, *facets])


def test_what_is_painted_is_named_prusa(tmp_path: Path) -> None:
    paint = {"slic3rpe__custom_seam": 1, "slic3rpe__mmu_segmentation": 12}
    names = '<config><object id="1"><metadata type="object" key="name" value="lid"/></object></config>'
    model = read(
        tmp_path,
        model_xml(
            {1: painted(mesh_xml(), **paint), 2: painted(mesh_xml(), slic3rpe__custom_seam=2), 3: mesh_xml()},
            item(1) + item(2, MOVED) + item(3, MOVED),
            more=' xmlns:slic3rpe="http://schemas.slic3r.org/3mf/2017/06"',
        ),
        {"Metadata/Slic3r_PE_model.config": names},
    )

    assert model.notes == (
        "painted seams are ignored: 3 facets of 'lid', 'object 2'",
        "painted colours are ignored: 12 facets of 'lid'",
    )
    assert model.mesh.n_facets == 36


def test_what_is_painted_is_named_bambu(tmp_path: Path) -> None:
    mesh = painted(mesh_xml(), paint_color=1, paint_fuzzy_skin=4, pid=5)
    text = model_xml({1: mesh, 3: group(component(1)), 4: mesh_xml()}, item(3) + item(4, MOVED))
    config = '<config><object id="3"><metadata key="name" value="Box"/></object></config>'

    assert read(tmp_path, text, {"Metadata/model_settings.config": config}).notes == (
        "painted colours are ignored: 1 facet of 'Box'",
        "painted fuzzy skin are ignored: 4 facets of 'Box'",
    )


def test_the_only_object_has_its_name(tmp_path: Path) -> None:
    lid = '<config><object id="1"><metadata type="object" key="name" value="lid"/></object></config>'
    model = read(tmp_path, model_xml({1: mesh_xml()}, item(1)), {"Metadata/Slic3r_PE_model.config": lid})

    assert [one.name for one in model.mesh.objects] == ["lid"]
    assert read(tmp_path, model_xml({1: mesh_xml()}, item(1))).mesh.objects == ()


def test_objects_without_a_name_are_called_what_the_slicer_calls_them(tmp_path: Path) -> None:
    text = model_xml({1: mesh_xml(), 2: mesh_xml(), 3: mesh_xml()}, item(1) + item(2) + item(3))
    text = text.replace('<object id="2"', '<object id="2" name="own name"')
    lid = '<metadata type="object" key="name" value="lid"/>'
    volume = '<volume firstid="0" lastid="11"><metadata type="volume" key="name" value="no"/></volume>'
    objects = "".join(f'<object id="{at}">{volume}{lid}</object>' for at in (1, 2))
    model = read(tmp_path, text, {"Metadata/Slic3r_PE_model.config": f"<config>{objects}</config>"})

    assert [one.name for one in model.mesh.objects] == ["lid", "own name", "part"]


BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
ONE = model_xml({1: mesh_xml()}, item(1))
FAULTS = {
    "vertex beyond the last": (ONE.replace('v1="0"', 'v1="99"', 1), "object 1: facet 1 uses vertex 99 of 8"),
    "vertex before the first": (ONE.replace('v1="0"', 'v1="-1"', 1), "vertex -1 of 8"),
    "vertex far beyond": (ONE.replace('v1="0"', f'v1="{10**30}"', 1), "line 1"),
    "no number": (ONE.replace('x="2.0"', 'x="two"', 1), "line 1: could not convert"),
    "missing coordinate": (ONE.replace(' z="0.0"', "", 1), "line 1: the attribute 'z' is missing"),
    "decimal comma": (ONE.replace('x="2.0"', 'x="2,0"', 1), "could not convert"),
    "object missing": (model_xml({1: mesh_xml()}, item(9)), "object 9 is placed but not defined"),
    "object twice": (
        ONE.replace("</resources>", f'<object id="1">{mesh_xml()}</object></resources>'), "object 1 is defined twice"
    ),
    "object in itself": (model_xml({1: group(component(1))}, item(1)), "nested more than"),
    "objects in a circle": (model_xml({1: group(component(2)), 2: group(component(1))}, item(1)), "nested more than"),
    "short transform": (model_xml({1: mesh_xml()}, item(1, (1, 0, 0))), "a transform must have 12 numbers"),
    "endless transform": (model_xml({1: mesh_xml()}, item(1, (float("inf"),) * 12)), "must have 12 numbers"),
    "no facets": (model_xml({1: "<mesh/>"}, item(1)), "the file contains no facets"),
    "cut off": (ONE[:-200], "not valid XML"),
    "no XML": ("hello", "not valid XML"),
    "extension": (
        model_xml({1: mesh_xml()}, item(1), more=f' xmlns:b="{BEAMS}" requiredextensions="p b"'),
        f"requires the 3MF extension '{BEAMS}'",
    ),
    "other namespace": (ONE.replace(CORE, "urn:other"), "no printable object"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), FAULTS.values(), ids=FAULTS.keys())
def test_a_broken_model_is_refused_with_what_is_wrong(text: str, message: str, tmp_path: Path) -> None:
    assert message in fault(tmp_path, three_mf(text))


def test_an_archive_without_a_model_is_refused(tmp_path: Path) -> None:
    assert "contains no 3D model" in fault(tmp_path, zipped({"readme.txt": "hello"}))


def test_an_archive_of_other_models_is_refused_with_their_names(tmp_path: Path) -> None:
    packed = zipped({"kit/Left.STL": b"solid", "kit/right.stl": b"solid", "readme.txt": b"print me"})

    for name in ("kit.zip", "kit.3mf"):
        with pytest.raises(MeshError) as caught:
            load_mesh(write(tmp_path, packed, name))
        assert "a ZIP archive of models (left.stl, right.stl), not a 3MF" in str(caught.value)
        assert "Unpack it" in caught.value.remedy


def test_a_model_file_that_is_missing_is_named(tmp_path: Path) -> None:
    text = model_xml({8: group(component(1, (), "/3D/other.model"))}, item(8))

    assert "does not contain '3d/other.model'" in fault(tmp_path, three_mf(text))


def test_names_that_lead_out_of_the_archive_lead_nowhere(tmp_path: Path) -> None:
    members = {"../../etc/passwd": "x", "/abs/3D/3dmodel.model": ONE, "C:\\x.model": ONE}

    assert "no 3D model" in fault(tmp_path, zipped(members))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.3mf"]


def test_a_damaged_archive_is_refused(tmp_path: Path) -> None:
    good = three_mf(ONE)
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 255

    assert "not a valid ZIP archive" in fault(tmp_path, bytes(flipped))
    assert "has no directory" in fault(tmp_path, good[:-30])


def test_ways_of_packing_that_3mf_does_not_allow_are_refused(tmp_path: Path) -> None:
    packed = zipped({"3D/3dmodel.model": ONE}, zipfile.ZIP_LZMA)

    assert "compressed with a method" in fault(tmp_path, packed)


def test_the_items_of_a_plate_are_things_of_their_own(tmp_path: Path) -> None:
    """With the names of their objects; what has none is called as the file, and components belong to their item."""
    text = model_xml(
        {1: mesh_xml(), 2: group(component(1) + component(1, MOVED)), 3: mesh_xml()},
        item(1) + item(2) + item(3),
    )
    text = text.replace('<object id="1"', '<object name="a part" id="1"').replace(
        '<object id="2"', '<object name="two" id="2"'
    )
    mesh = read(tmp_path, text).mesh

    assert [one.name for one in mesh.objects] == ["a part", "two", "part"]
    assert [(one.first, one.count) for one in mesh.objects] == [(0, 12), (12, 24), (36, 12)]
    for one in mesh.objects:
        own = mesh.triangles[one.first : one.first + one.count].reshape(-1, 3)
        assert one.low == pytest.approx(own.min(axis=0))
        assert one.high == pytest.approx(own.max(axis=0))


def test_a_single_item_is_no_plate(tmp_path: Path) -> None:
    assert read(tmp_path, model_xml({1: mesh_xml()}, item(1))).mesh.objects == ()


def test_facets_left_out_leave_the_envelopes(tmp_path: Path) -> None:
    faces = [*FACES, (0, 0, 1)]
    mesh = read(
        tmp_path, model_xml({1: mesh_xml(CORNERS, faces), 2: mesh_xml()}, item(1) + item(2, MOVED))
    ).mesh

    assert [one.count for one in mesh.objects] == [0, 0]
    assert mesh.objects[0].high == pytest.approx(CORNERS.max(axis=0))
