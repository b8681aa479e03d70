"""The schemas for editors agree with what is accepted, and what is made from the settings is current."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.profile import KINDS, find_profile_paths, load_profile
from printer_slicer.profile.document import format_overrides_markdown, format_settings_markdown
from printer_slicer.profile.schema import (
    format_schema,
    format_schema_directive,
    make_schema,
    make_schema_name,
)
from printer_slicer.profile.tables import list_setting_definitions

ROOT = Path(__file__).parents[2]
FILES = [(kind, name) for kind in KINDS for name in find_profile_paths(kind)]
VALIDATORS = {kind: jsonschema.Draft202012Validator(make_schema(kind)) for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_the_shipped_schema_is_the_one_of_the_code(kind: str) -> None:
    shipped = (ROOT / "profiles" / "schema" / make_schema_name(kind)).read_text(encoding="utf-8")

    assert shipped == format_schema(kind), "run `just settings`"


def test_the_document_of_settings_is_the_one_of_the_code() -> None:
    assert (ROOT / "docs" / "reference" / "settings.md").read_text(
        encoding="utf-8"
    ) == format_settings_markdown(), "run `just settings`"


def test_the_document_tells_every_setting_with_its_meaning() -> None:
    text = format_settings_markdown()

    for row in list_setting_definitions():
        assert f"| `{row.key.rpartition('.')[2]}` |" in text
        assert row.meaning.replace("|", "/") in text


def test_the_table_of_settings_that_may_differ_is_the_one_of_the_code() -> None:
    text = (ROOT / "docs" / "profiles.md").read_text(encoding="utf-8")

    assert (
        text.partition("<!-- own settings -->\n")[2].partition("<!-- end -->")[0]
        == format_overrides_markdown()
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_is_one(kind: str) -> None:
    jsonschema.Draft202012Validator.check_schema(make_schema(kind))


@pytest.mark.parametrize(("kind", "name"), FILES, ids=" ".join)
def test_every_shipped_file_obeys_its_schema_and_names_it(kind: str, name: str) -> None:
    path = find_profile_paths(kind)[name]
    text = path.read_text(encoding="utf-8")

    VALIDATORS[kind].validate(tomllib.loads(text))
    assert text.startswith(format_schema_directive(kind) + "\n")
    assert (path.parent / format_schema_directive(kind).removeprefix("#:schema ")).resolve().is_file()


@pytest.mark.parametrize("kind", KINDS)
def test_every_setting_of_a_schema_tells_what_it_means(kind: str) -> None:
    schema = make_schema(kind)
    groups = [schema, *schema.get("$defs", {}).values()]
    rows = [
        (row.key.rpartition(".")[2], row.unit)
        for row in list_setting_definitions()
        if row.key.startswith(kind)
    ]

    for group in groups:
        for key, told in group["properties"].items():
            if key in ("planner", "speeds", "accelerations", "kind", "low", "high"):
                continue
            assert told["description"], key
            units = {unit for name, unit in rows if name == key}
            assert not units or any(
                not unit or told["description"].endswith(f" [{unit}]") for unit in units
            ), key


FAULTY = [
    ("quality", "perimeters = 101"),
    ("quality", "infill_density = -0.1"),
    ("quality", 'seam = "front"'),
    ("quality", "perimetres = 3"),
    ("quality", "[speeds]\ntravel = -1"),
    ("quality", "[speeds]\ntravl = 9"),
    ("quality", '[planner]\nkind = "cosp"'),
    ("quality", '[planner]\nkind = "uniform"\ntolerance = 1'),
    ("quality", 'planner = { kind = "optimal", ranges = [{ low = 1 }] }'),
    ("quality", "overrides = [{}]"),
    ("quality", "[[overrides]]\nset = { perimeters = 3 }"),
    ("quality", "[[overrides]]\nlow = 1\nset = { perimeters = 101 }"),
    ("quality", "[[overrides]]\nlow = 1\nset = { perimetres = 3 }"),
    ("quality", "[[overrides]]\nhihg = 1\nset = { perimeters = 3 }"),
    ("quality", '[[overrides]]\nobject = "lid"\nset = { nozzle_temperature = 200 }'),
    ("quality", '[[overrides]]\nhigh = 3\nset = { "speeds.internal_infill" = -1 }'),
    ("quality", '[[overrides]]\nhigh = 3\nset = { seam = "rear" }'),
    ("printer", 'flavour = "grbl"'),
    ("printer", 'thumbnails = ["32"]'),
    ("printer", "bed_x = true"),
    ("material", "density = 0"),
    ("material", "bed_x = 200"),
    ("material", "inherits = 3"),
    ("printer", 'aliases = "Ender-3 Pro"'),
    ("printer", "aliases = [3]"),
]


@pytest.mark.parametrize(("kind", "text"), FAULTY)
def test_what_is_refused_does_not_obey_the_schema(tmp_path: Path, kind: str, text: str) -> None:
    parent = {"printer": "marlin_220", "material": "pla", "quality": "standard"}[kind]
    path = tmp_path / "faulty.toml"
    path.write_text(("" if "inherits" in text else f'inherits = "{parent}"\n') + text, encoding="utf-8")
    names: dict[str, Any] = {kind: str(path)}

    with pytest.raises(ProfileError):
        load_profile(**names)
    assert not VALIDATORS[kind].is_valid(tomllib.loads(path.read_text(encoding="utf-8")))


TAKEN = [
    ("printer", 'aliases = ["Ender-3 Pro"]'),
    (
        "quality",
        '[[overrides]]\nobject = "lid"\nhigh = 3\nset = { perimeters = 3, "speeds.internal_infill" = 40 }',
    ),
    ("quality", "[[overrides]]\nlow = 2\nset = { nozzle_temperature = 200, 'quality.infill' = 'grid' }"),
    ("quality", 'overrides = "1:2:perimeters=3"\nlayer_heights = "0.2"'),
    ("quality", '[planner]\nkind = "optimal"\nranges = "1:2:tolerance=0.1"'),
    ("quality", "planner = {}"),
    ("printer", 'thumbnails = "32x32"'),
]


@pytest.mark.parametrize(("kind", "text"), TAKEN)
def test_what_is_taken_obeys_the_schema(tmp_path: Path, kind: str, text: str) -> None:
    parent = {"printer": "marlin_220", "quality": "standard"}[kind]
    path = tmp_path / "good.toml"
    path.write_text(f'inherits = "{parent}"\n{text}', encoding="utf-8")
    names: dict[str, Any] = {kind: str(path)}

    load_profile(**names)
    VALIDATORS[kind].validate(tomllib.loads(path.read_text(encoding="utf-8")))


def test_a_file_that_does_not_inherit_must_say_what_has_no_default() -> None:
    assert not VALIDATORS["printer"].is_valid({"name": "mine", "bed_x": 200})
    assert not VALIDATORS["quality"].is_valid({"name": "mine", "planner": {}})
    assert VALIDATORS["quality"].is_valid({"name": "mine", "planner": {"kind": "cusp"}})


def test_a_schema_is_plain_json_with_a_title() -> None:
    for kind in KINDS:
        assert json.loads(format_schema(kind))["title"] == f"{kind} profile of printer_slicer"
