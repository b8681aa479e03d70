"""Macros of other slicers: what comes out of ours is what would come out of theirs."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from printer_slicer.importing.conditions import value_of
from printer_slicer.importing.foreign import Unreadable, parse_foreign, words_of
from printer_slicer.importing.macros import translated
from printer_slicer.importing.translation import Translator
from printer_slicer.macros import read_template

PRINTER = {
    "nozzle_diameter": "0.4,0.4",
    "printer_notes": "MODEL_X",
    "printer_model": "X1",
    "z_offset": "0.1",
    "silent_mode": "1",
}
KNOWN = {
    "first_layer_nozzle_temperature": 215.0, "nozzle_temperature": 210.0, "bed_temperature": 60.0,
    "first_layer_bed_temperature": 65.0, "nozzle_diameter": 0.4, "bed_z": 200.0, "part_height": 12.5, "layer_z": 0.6,
    "layer_num": 2.0, "layer_count": 60.0, "layer_tops": (0.3, 0.5, 0.7), "quality.layer_height": 0.2,
    "material.type": "PETG", "material_name": "Prusament PETG", "quality_name": "0.20mm QUALITY @MK3", "tool": 0.0,
    "quality.speeds.travel": 150.0, "retract_length": 0.8, "bed_x": 220.0, "bed_y": 210.0, "acceleration": 1250.0,
    "first_layer_min": (10.0, 20.0), "first_layer_max": (30.0, 40.0),
}  # fmt: skip


def lines(text: str, dialect: str = "prusaslicer", *, in_layers: bool = False) -> list[str]:
    """What our file holds for a macro of theirs."""
    translator = Translator(PRINTER, dialect, in_layers, ((0, 0), (220, 210)))
    macro = translated(text, translator, "start", square=dialect != "cura")
    return read_template(macro.text, "start").filled(KNOWN)


def notes(text: str) -> list[str]:
    return [note.text for note in translated(text, Translator(PRINTER), "here").notes]


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("M104 S[first_layer_temperature]", "M104 S215"),
        ("M104 S{first_layer_temperature[0]}", "M104 S215"),
        ("M104 S[first_layer_temperature_0] T[initial_tool]", "M104 S215 T0"),
        ("M104 S{first_layer_temperature[initial_extruder]-15}", "M104 S200"),
        ("M104 S[first_layer_temperature[initial_tool]]", "M104 S215"),
        ("M104 S{temperature[0] * 0.791}", "M104 S166.11"),
        ("M104 S{temperature[0] / 4}", "M104 S52"),  # whole numbers divide to whole numbers there
        ("M104 S{temperature[0] / 4.0}", "M104 S52.5"),
        ("M104 S{temperature[0] % 100}", "M104 S10"),
        ("M104 S{int(temperature[0] * 0.5 + 0.6)} {round(2.5)} {-2.5}", "M104 S105 3 -2.5"),
        ("G1 Z{min(max_layer_z + 30, max_print_height)}", "G1 Z42.5"),
        ("G1 Z{z_offset+min(max_layer_z+2, max_print_height)}", "G1 Z14.6"),
        ("G1 Z[first_layer_height]", "G1 Z0.3"),
        ("G1 X{first_layer_print_min[0]} Y{first_layer_print_max[1]}", "G1 X10 Y40"),
        ("G1 X{print_bed_max[0]/2} Y{print_bed_size[1]}", "G1 X110 Y210"),
        ("M221 S{if layer_height<0.075}100{else}95{endif}", "M221 S95"),
        ("{if nozzle_diameter[0]==0.6}A{elsif nozzle_diameter[0]==0.4}B{else}C{endif}", "B"),
        ('{if filament_type[0]=="PETG"}A{else}B{endif}', "A"),
        ("{if filament_type[0]=~/PLA|PETG/}A{else}B{endif}", "A"),
        ("{if filament_settings_id[initial_tool]=~/.*Prusament PA11.*/}A{else}B{endif}", "B"),
        ("{if print_settings_id=~/.*(DETAIL @MK3|QUALITY @MK3).*/}A{else}B{endif}", "A"),
        ("{if print_settings_id!~/0.20mm.*/}A{else}B{endif}", "B"),
        ("{if printer_notes=~/.*MODEL_X.*/ and not has_wipe_tower}A{else}B{endif}", "A"),
        ("{if silent_mode}A{else}B{endif}", "A"),
        ("{if is_extruder_used[0] and !is_extruder_used[1]}A{endif}", "A"),
        ('M403 F{"" + ((filament_type[0]=="FLEX") ? 1 : 2)}', "M403 F2"),
        ('M117 {"layers: " + total_layer_count}', "M117 layers: 60"),
        ("M862.3 P \"[printer_model]\"", 'M862.3 P "X1"'),
        ("F{travel_speed*60} [retract_length] [machine_max_acceleration_extruding]", "F9000 0.8 1250"),
        ("G1 X5 ; [unheard_of] stays in a remark", "G1 X5 ; [unheard_of] stays in a remark"),
        ("M117 {zdigits(layer_num, 3)}", "M117 059"),
        ("[1] is no name", "[1] is no name"),
    ],
)  # fmt: skip
def test_what_means_the_same_comes_out_the_same(theirs: str, ours: str) -> None:
    assert lines(theirs) == [ours]


@pytest.mark.parametrize(
    ("dialect", "theirs", "ours"),
    [
        ("orca", "M104 S[nozzle_temperature_initial_layer]", "M104 S215"),
        ("orca", "M190 S[bed_temperature_initial_layer_single]", "M190 S65"),
        ("orca", "{if printable_height > 100}Z{max_layer_z + 1}{endif}", "Z13.5"),
        ("cura", "M104 S{material_print_temperature_layer_0}", "M104 S215"),
        ("cura", "M104 S{material_print_temperature_layer_0, initial_extruder_nr}", "M104 S215"),
        ("cura", "M190 S{material_bed_temperature} ; [bed]", "M190 S60 ; [bed]"),
        ("cura", "G1 Y{machine_depth - 10} [x]", "G1 Y200 [x]"),
    ],
)
def test_names_of_other_slicers(dialect: str, theirs: str, ours: str) -> None:
    assert lines(theirs, dialect) == [ours]


def test_layers_count_from_where_they_begin() -> None:
    assert lines(";{layer_num} {layer_z} [layer_z]", in_layers=True) == [";2 0.6 0.6"]


@pytest.mark.parametrize(
    "theirs",
    [
        "M104 S{temperature[1]}",
        "M104 S{random(1, 2)}",
        "M104 S{unheard_of}",
        "M104 S[unheard_of]",
        "M117 [input_filename_base]",
        "M104 S{temperature[0]",
        "M104 S{}",
        "{local x = 5}",
        "M104 S{digits(temperature[0], 5)}",
        "{if temperature[0]}M1{endif}",
        "{if filament_type[0]=~/P[LE].*/}M1{endif}",
        "{endif}",
        "{if true}M1",
        "M1 {elsif true}",
        'G1 X{"a" * 2}',
    ],
)
def test_what_has_no_counterpart_stays_as_a_comment_with_a_warning(theirs: str) -> None:
    assert lines(f"G28\n{theirs}\nM84") == [
        "G28",
        *(f"; not translated: {line}" for line in [theirs]),
        "M84",
    ] or ("{if true}" in theirs)
    assert all(line.startswith(("; ", "G28", "M84")) for line in lines(f"G28\n{theirs}\nM84"))
    assert any("kept as" in note for note in notes(f"G28\n{theirs}\nM84"))


def test_a_block_stays_where_only_a_line_in_it_has_no_counterpart() -> None:
    text = "{if layer_height < 0.3}\nM104 S{unheard_of}\nG28\n{else}\nM1\n{endif}\nM84"

    assert lines(text) == ["; not translated: M104 S{unheard_of}", "G28", "M84"]


def test_half_a_command_is_never_left() -> None:
    text = "M104 S{if layer_height < 0.3}{unheard_of}{else}200{endif} ; heat\nG28"

    assert lines(text) == [f"; not translated: {text.splitlines()[0]}", "G28"]


def test_a_block_over_lines_whose_condition_has_no_counterpart_is_a_comment_as_a_whole() -> None:
    text = "G28\n{if unheard_of > 1}\nM104 S1\n{endif}\nM84"
    found = lines(text)

    assert found[0] == "G28"
    assert found[-1] == "M84"
    assert found[1:-1] == [
        "; not translated: {if unheard_of > 1}",
        "; not translated: M104 S1",
        "; not translated: {endif}",
    ]


@pytest.mark.parametrize("indent", ["", "  "])
def test_what_stands_behind_a_block_of_lines_is_a_line_of_its_own(indent: str) -> None:
    macro = f"{indent}{{if unheard_of > 1}}\nM104 S1\n{indent}{{endif}}M106 P3 S80\nM84"
    made = translated(macro, Translator({}), "here")

    assert made.text.splitlines()[-2:] == ["M106 P3 S80", "M84"]
    assert "'{if unheard_of > 1}' and 2 more lines kept as a comment" in made.notes[0].text


def test_in_a_branch_too() -> None:
    text = "{if layer_height < 0.3}\nG28\n{if unheard_of}\nM104 S1\n{endif}M106 P3 S80\nM84\n{endif}"
    found = [line for line in lines(text) if not line.startswith(";")]

    assert found == ["G28", "M106 P3 S80", "M84"]


NAMES = (
    "temperature[0]",
    "bed_temperature[0]",
    "nozzle_diameter[0]",
    "max_print_height",
    "layer_height",
    "travel_speed",
)
SETTINGS = {
    "temperature": "210", "bed_temperature": "60", "nozzle_diameter": "0.4", "max_print_height": "200.5",
    "layer_height": "0.2", "travel_speed": "150.5",
}  # fmt: skip
OUR_VALUES = {
    "nozzle_temperature": 210.0, "bed_temperature": 60.0, "nozzle_diameter": 0.4, "bed_z": 200.5,
    "quality.layer_height": 0.2, "quality.speeds.travel": 150.5,
}  # fmt: skip
ATOMS = st.sampled_from(NAMES) | st.integers(0, 300).map(str) | st.sampled_from(["0.5", "2.25", "1e1"])


def combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    two = st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "%"]), inner)
    order = st.tuples(inner, st.sampled_from(["<", ">", "<=", ">=", "==", "!="]), inner)
    return (
        two.map(lambda found: f"({found[0]}) {found[1]} ({found[2]})")
        | st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(
            lambda found: f"{found[0]}({found[1]}, {found[2]})"
        )
        | st.tuples(st.sampled_from(["int", "round"]), inner).map(lambda found: f"{found[0]}({found[1]})")
        | inner.map(lambda found: f"-({found})")
        | st.tuples(order, inner, inner).map(
            lambda found: f"({' '.join(found[0])} ? {found[1]} : {found[2]})"
        )
        | st.tuples(inner, inner).map(lambda found: f"{found[0]} - {found[1]} * 2")
    )


@example("7 / min(2, 3.5)")
@given(st.recursive(ATOMS, combined, max_leaves=8))
def test_expressions_have_the_same_value_in_both_languages(text: str) -> None:
    translator = Translator({"nozzle_diameter": "0.4"})
    try:
        tree = parse_foreign(words_of(text))
        expected = value_of(tree, SETTINGS)
        if "%" in text and isinstance(expected, float):
            return  # remainders of fractions are no part of their language
        ours = translator.said(tree).text
    except Unreadable:
        return
    (found,) = read_template(f"{{{ours}}}", "here").filled(OUR_VALUES)

    assert float(found) == pytest.approx(float(expected), abs=2e-5, rel=1e-9)


@given(st.text(alphabet='{}[]ifendsla temperature_0+-*/()"\\;\n=~<>?:,.[]{}éx', max_size=120))
def test_any_text_becomes_a_macro_that_can_be_read_and_filled(text: str) -> None:
    macro = translated(text, Translator(PRINTER), "here")
    found = read_template(macro.text, "here").filled(KNOWN)

    assert not any(re.match(r"\s*;? ?not translated: $", line) for line in found)
