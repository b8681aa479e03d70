"""The language of macros: expressions have the values that another evaluator finds; garbage gives text or an error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.errors import ProfileError
from printer_slicer.macros import (
    Value,
    add_names_of_other_slicers,
    escape_braces,
    format_value,
    read_template,
)
from printer_slicer.texts import format_number
from tests.effort import examples

KNOWN: dict[str, Value] = {
    "a": 3.0,
    "b": -0.5,
    "part.height": 12.25,
    "on": True,
    "off": False,
    "name": "PLA",
    "tops": (0.2, 0.4, 0.8),
    "names": ("cube", "ball"),
    "nozzle_temperature": 210.0,
}


def made(text: str) -> str:
    return "\n".join(read_template(text, "start_gcode").render(KNOWN))


def refused(text: str) -> ProfileError:
    with pytest.raises(ProfileError) as caught:
        made(text)
    return caught.value


# Random expressions, and what they are worth to somebody else


@dataclass(frozen=True)
class Case:
    """Text of an expression and its value; None where there is none."""

    text: str
    value: Any


def either(*values: Any) -> bool:
    return any(value is None for value in values)


def divided(a: Any, b: Any) -> Any:
    whole = isinstance(a, int) and isinstance(b, int)
    return math.trunc(Fraction(a, b)) if whole else a / b


def binary(sign: str, left: Case, right: Case) -> Case:
    a, b = left.value, right.value
    text = f"({left.text} {sign} {right.text})"
    if sign in ("and", "or"):
        stops = a is (sign == "or")
        return Case(text, None if a is None else a if stops else b)
    if either(a, b):
        return Case(text, None)
    compared = {
        "==": lambda: math.isclose(a, b, rel_tol=0, abs_tol=1e-9),
        "!=": lambda: not math.isclose(a, b, rel_tol=0, abs_tol=1e-9),
        "<": lambda: b - a > 1e-9,
        "<=": lambda: a - b <= 1e-9,
        ">": lambda: a - b > 1e-9,
        ">=": lambda: b - a <= 1e-9,
        "+": lambda: a + b,
        "-": lambda: a - b,
        "*": lambda: a * b,
        "/": lambda: divided(a, b) if b else None,
    }[sign]()
    large = isinstance(compared, (int, float)) and abs(compared) > 1e15
    return Case(text, None if large else compared)


def choice(condition: Case, yes: Case, no: Case) -> Case:
    chosen = None if condition.value is None else yes.value if condition.value else no.value
    return Case(f"({condition.text} ? {yes.text} : {no.text})", chosen)


def call(name: str, arguments: list[Case]) -> Case:
    values = [one.value for one in arguments]
    text = f"{name}({', '.join(one.text for one in arguments)})"
    if either(*values):
        return Case(text, None)
    found = {"min": min, "max": max}[name](values)
    return Case(text, found if all(isinstance(one, int) for one in values) else float(found))


LITERALS = st.one_of(
    st.integers(0, 999).map(lambda n: Case(str(n), n)),
    st.integers(0, 9999).map(lambda n: Case(f"{n / 100:.2f}", n / 100)),
    st.sampled_from(["a", "b", "part.height"]).map(lambda name: Case(name, KNOWN[name])),
    st.integers(0, 2).map(lambda at: Case(f"tops[{at}]", (0.2, 0.4, 0.8)[at])),
)
TRUTHS = st.sampled_from([Case("true", True), Case("false", False), Case("on", True), Case("off", False)])


def more_numbers(numbers: st.SearchStrategy[Case]) -> st.SearchStrategy[Case]:
    return st.one_of(
        st.builds(binary, st.sampled_from("+-*/"), numbers, numbers),
        numbers.map(lambda one: Case(f"(-{one.text})", None if one.value is None else -one.value)),
        st.builds(call, st.sampled_from(["min", "max"]), st.lists(numbers, min_size=1, max_size=4)),
        numbers.map(lambda one: Case(f"abs({one.text})", None if one.value is None else abs(one.value))),
        st.builds(choice, conditions(numbers), numbers, numbers),
    )


def conditions(numbers: st.SearchStrategy[Case]) -> st.SearchStrategy[Case]:
    compared = st.builds(binary, st.sampled_from(["==", "!=", "<", "<=", ">", ">="]), numbers, numbers)
    plain = st.one_of(TRUTHS, compared)
    return st.one_of(
        plain,
        plain.map(lambda one: Case(f"(not {one.text})", None if one.value is None else not one.value)),
        st.builds(binary, st.sampled_from(["and", "or"]), plain, plain),
    )


NUMBERS = st.recursive(LITERALS, more_numbers, max_leaves=12)


@given(st.one_of(NUMBERS, conditions(NUMBERS)))
@settings(max_examples=examples(100))
def test_an_expression_has_the_value_that_another_evaluator_finds(case: Case) -> None:
    if case.value is None or len(case.text) > 400:
        return  # no value, or longer than what is read

    assert made(f"{{{case.text}}}") == format_value(case.value)


@given(NUMBERS)
def test_an_expression_without_a_value_is_an_error_with_its_place(case: Case) -> None:
    if case.value is None:
        assert "start_gcode: line 1, column" in str(refused(f"{{{case.text}}}"))


MARKS = ["{", "}", "{{", "}}", "{if ", "{elif ", "{else}", "{endif}"]
SIGNS = [*"[]()+-*/%?:<!,;\"'\\", "==", "and ", "or ", "not ", "min(", "text("]
PIECES = st.sampled_from(
    [*MARKS, *SIGNS, "a", "on", "name", "tops", "1", "0.5", "1e9", "é", "\x00", " ", "\r\n", "\n"]
)


@given(st.one_of(st.lists(PIECES, max_size=40).map("".join), st.text(max_size=60)))
@settings(max_examples=examples(100))
def test_garbage_gives_text_or_an_error_that_says_where(text: str) -> None:
    try:
        lines = read_template(text, "start_gcode").render(KNOWN)
    except ProfileError as error:
        place = str(error).splitlines()
        assert place[0].startswith("start_gcode: line ")
        assert place[2].strip() == "^"
    else:
        assert all(isinstance(line, str) for line in lines)


@given(st.text(max_size=50))
def test_an_escaped_text_comes_out_as_it_is(text: str) -> None:
    plain = text.replace("\r\n", "\n")

    assert made(escape_braces(f"x{text}x")) == "\n".join(f"x{plain}x".splitlines())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{{", "{"),
        ("{{a}} {{{a}}}", "{a} {3}"),
        ("}", "}"),
        ("x}} {{\n}}", "x}} {\n}}"),
        ("[1] [ x y ] [ ]", "[1] [ x y ] [ ]"),
    ],
)
def test_braces_and_brackets_that_are_no_placeholders(text: str, expected: str) -> None:
    assert made(text) == expected


@given(st.floats(-1e9, 1e9))
def test_numbers_have_no_exponent_and_no_needless_zeros(value: float) -> None:
    text = format_number(value)

    assert float(text) == pytest.approx(value, abs=5.1e-6)
    assert not text.endswith(".")
    assert not (("." in text) and text.endswith("0"))
    assert "e" not in text
    assert text != "-0"


# What is said in words


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{2 + 3 * 4 - 6 / 3}", "12"),
        ("{(2 + 3) * 4 % 7}", "6"),
        ("{-7 % 3} {7 % -3} {0.6 % 0.2} {7.5 % 2}", "-1 1 0 1.5"),
        ("{7 / 2} {-7 / 2} {7 / 2.0} {2*3/12} {2.*3/12}", "3 -3 3.5 0 0.5"),
        ('{"a" + 1 + 1.5} {1 + "a"} {"a" + true}', "a11.5 1a atrue"),
        ("{digits(3.14159, 8, 2)}|{zdigits(7, 3)}|{digits(7, 3)}|{zdigits(-7, 5)}|{zdigits(3.14159, 8, 2)}",
         "    3.14|007|  7|-0007|00003.14"),
        ("{interpolate_table(13, (0, 0), (20, 20), (30, 20))}", "13"),
        ("{interpolate_table(-1, (0, 5), (20, 20))} {interpolate_table(99, (0, 5), (20, 20))}", "5 20"),
        ('{one_of(name, "ABS", "PLA")} {one_of(name, /P.*/)} {one_of(name, "P")}', "true true false"),
        ("{name =~ /P.A/} {name !~ /P/} {name =~ /L/}", "true true false"),
        ("{is_nil(a)} {empty((1, 2))} {empty(())} {size((1, 2))}", "false false true 2"),
        ("{local x = 33 + 2}{x}{x = 12}{x}", "3512"),
        ("{local x = (2*3, 4*6, 5*5)}{x[1]} {x} {x[1] = 7}{x[1]} {x[9]}", "24 6 7 6"),
        ("{local x = repeat(6, 24)}{x[5]} {size(x)}", "24 6"),
        ("{if 1 == 0 then local x = (5, 4); else; local y = (1., 2., 3.); endif}{size(y)}", "3"),
        ("{if on then if off}no{else local x = (6, 5) endif else if no * x then else 1 endif endif}{size(x)}", "2"),
        ("{if false then elsif false then else endif}", ""),
        ('{if on then "x"; a else "y" endif}', "x3"),
        ("[a] [tops[1]] [name]", "3 0.4 PLA"),
        ("{if on\n}x{endif}{min(a,\n1)}", "x1"),
        ("{not 1 > 2 and 2 > 1 or false}", "true"),
        ("{!off && on || off}", "true"),
        ("{1 > 2 ? 'a' : 2 > 1 ? 'b' : 'c'}", "b"),
        ("{0.1 + 0.2 == 0.3} {0.1 + 0.2 > 0.3} {0.1 + 0.2 <= 0.3}", "true false true"),
        ("{name + '-' + text(a)}", "PLA-3"),
        ("{name == \"PLA\"} {'abc' < 'abd'}", "true true"),
        ("{'}'} {\"say \\\"hi\\\"\"}", '} say "hi"'),
        ("{tops[size(tops) - 1]} {names[1]} {tops}", "0.8 ball 0.2, 0.4, 0.8"),
        ("{min(tops)} {max(1, 2, 3)} {min(7)}", "0.2 3 7"),
        ("{round(2.5)} {round(-2.5)} {round(1.005, 2)} {round(2.345, 1)}", "3 -3 1.01 2.3"),
        ("{floor(-1.5)} {ceil(-1.5)} {int(-1.5)} {int(0.6 / 0.2)} {ceil(0.6 / 0.2)}", "-2 -1 -1 3 3"),
        ("{sqrt(2)} {fixed(2, 3)} {fixed(-0.001, 2)} {padded(7, 3)} {padded(-7, 3)}", "1.41421 2.000 0.00 007 -07"),
        ("{off and 1 / 0 > 1} {on or nozzle_temperature / 0 > 1}", "false true"),
        ("{on ? 1 : 1 / 0}", "1"),
        ("{part.height}{ a }", "12.253"),
        ("{--a} {- -a} {+a}", "3 3 3"),
    ],
)  # fmt: skip
def test_expressions(text: str, expected: str) -> None:
    assert made(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{if a > 2}\nG28\n{endif}", "G28"),
        ("{if a > 4}\nG28\n{elif on}\n  G29\n{else}\nG30\n{endif}\nM84", "  G29\nM84"),
        ("{local x = 1}\nG1 X{x}\n  {x = 2}{if x > 1}\nM{x}\n{endif}", "G1 X1\nM2"),
        ("{if off}A{elsif on}B{endif}{if off}A{elseif on}B{endif}", "BB"),
        ("{if off}{nozle_temperature}{nosuch(1)}{endif}x", "x"),
        ("G1 X1 ; [nobody] {nobody + 1} {a}", "G1 X1 ; [nobody] {nobody + 1} 3"),
        ("A\n{if off}\nB\n{endif}\nC", "A\nC"),
        ("M104 S{if on}1{else}2{endif}{if off}3{endif}", "M104 S1"),
        ("{if on}\n{if off}\nX\n{else}\nY{a}\n{endif}\n{endif}", "Y3"),
        ("  {if on}  \nX\n\t{endif}\n", "X"),
        ("{if on} ; not alone\nX\n{endif}", " ; not alone\nX"),
        ("{if off}{a / 0}{endif}", ""),
    ],
)
def test_blocks(text: str, expected: str) -> None:
    assert made(text) == expected


@pytest.mark.parametrize(
    ("text", "line", "column", "words"),
    [
        ("G28\nM104 S{nozle_temperature}", 2, 8, ["unknown placeholder", "{nozzle_temperature}"]),
        ("G1 X{1 / (a - 3)}", 1, 8, ["division by zero"]),
        ("{1 % 0}", 1, 4, ["division by zero"]),
        ("{on + 1}", 1, 5, ["cannot apply + to a boolean and a number"]),
        ("{on < off}", 1, 5, ["cannot apply < to a boolean and a boolean"]),
        ("{tops + 1}", 1, 7, ["cannot apply + to a list and a number"]),
        ("{-name}", 1, 3, ["expected a number, got a text"]),
        ("{if a}\n{endif}", 1, 5, ["a number is not a condition"]),
        ("{name ? 1 : 2}", 1, 2, ["a text is not a condition"]),
        ("{tops[3]}", 1, 7, ["no item 3", "list of 3"]),
        ("{tops[0.5]}", 1, 7, ["whole number"]),
        ("{a[0]}", 1, 3, ["a number has no items"]),
        ("{flor(1)}", 1, 2, ["unknown function flor()", "floor()"]),
        ("{sqrt(-1)}", 1, 2, ["no square root"]),
        ("{round(1, 2, 3)}", 1, 2, ["expected 1 or 2 arguments, got 3"]),
        ("{fixed(1, 0.5)}", 1, 2, ["number of digits"]),
        ("{a b}", 1, 4, ["'b'", "operator"]),
        ("{a +}", 1, 5, ["end of the expression", "a value"]),
        ("{(a}", 1, 4, ["end of the expression", ")"]),
        ("{1 < a < 4}", 1, 8, ["chains"]),
        ("{'open}", 1, 2, ["unterminated"]),
        ("{}", 1, 2, ["nothing between"]),
        ("a { b", 1, 3, ["unmatched brace"]),
        ("{if on}\nG28", 1, 1, ["without {endif}"]),
        ("{if on}\n{if off}\n{endif}\nG28", 1, 1, ["without {endif}"]),
        ("{endif}", 1, 1, ["without {if"]),
        ("{if on}{else}\n{elif on}{endif}", 2, 1, ["after {else}"]),
        ("{if}{endif}", 1, 4, ["without a condition"]),
        ("{a = 3}", 1, 2, ["unknown variable a", "{local a"]),
        ("{if a = 3}{endif}", 1, 7, ["Write =="]),
        ("{a - name}", 1, 4, ["cannot apply - to a number and a text"]),
        ("{a b; c}", 1, 4, ["'b'"]),
        ("{local a}", 1, 9, ["expected ="]),
        ("[nobody]", 1, 2, ["unknown placeholder {nobody}"]),
        ("{name =~ 'P'}", 1, 10, ["expected a pattern", "slashes"]),
        ("{name =~ /(/}", 1, 10, ["invalid"]),
        ("{local x = (1, 2)}{x[2] = 1}", 1, 22, ["no item 2"]),
        ("{(1, (2, 3))}", 1, 2, ["no lists"]),
        ("{repeat(1e9, 1)}", 1, 2, ["repeat()"]),
        ("{interpolate_table(1, (2, 1), (1, 2))}", 1, 2, ["sorted by x"]),
        ("{1e200}", 1, 2, ["larger than"]),
        ("{1e10 * 1e10}", 1, 7, ["larger than"]),
    ],
)  # fmt: skip
def test_errors_name_the_place_and_mark_it(text: str, line: int, column: int, words: list[str]) -> None:
    error = refused(text)
    head, shown, mark = str(error).splitlines()[:3]

    assert head.startswith(f"start_gcode: line {line}, column {column}: ")
    assert shown == "  " + text.split("\n")[line - 1]
    assert mark == " " * (1 + column) + "^"
    assert [word for word in words if word not in str(error)] == []


def test_the_mark_stands_under_the_place_in_long_lines_too() -> None:
    _, shown, mark = str(refused("x" * 500 + "{nope}" + "y" * 500)).splitlines()[:3]

    assert len(shown) <= 110
    assert shown[mark.index("^") :].startswith("nope")


@pytest.mark.parametrize(
    "text",
    [
        "{" + "(" * 5000 + "1" + ")" * 5000 + "}",
        "{" + "-" * 5000 + "1}",
        "{" + "not " * 5000 + "on}",
        "{" + "+".join("1" * 5000) + "}",
        "{" + "on ? 1 : " * 5000 + "2}",
        "{" + "tops[" * 5000 + "0" + "]" * 5000 + "}",
        "{(" + "1, " * 5000 + "1)}",
        '{local x = "xxxxxxxxxx"}' + "{x = x + x}" * 60,
        "{local x = repeat(10000, 'xxxx')}" + "{text(x + x)}" * 3 + "{zdigits(1, 101)}",
        "x" * 1_000_000 + "{a}",
        "{if on}\n" * 5000 + "{endif}\n" * 5000,
    ],
)
def test_what_is_nested_without_end_is_refused(text: str) -> None:
    assert "column" in str(refused(text))


def test_an_expression_as_long_as_may_be_is_evaluated() -> None:
    assert made("{" + "+".join("1" * 100) + "}") == "100"
    assert made("{" + "(" * 25 + "1" + ")" * 25 + "}") == "1"


def test_what_comes_out_has_an_end() -> None:
    known: dict[str, Value] = {"long": "x" * 1000}

    with pytest.raises(ProfileError, match=r"longer than \d+ characters"):
        read_template("{long}" * 1001, "start_gcode").render(known)


def test_names_and_functions_are_looked_up_in_branches_that_are_left_out() -> None:
    with pytest.raises(ProfileError, match=r"start_gcode: line 2, column 2: unknown placeholder \{nozle\}"):
        read_template("{if off}\n{nozle}\n{endif}", "start_gcode").check(KNOWN)
    with pytest.raises(ProfileError, match=r"unknown function flor\(\)"):
        read_template("{if off}{flor(a)}{endif}", "start_gcode").check(KNOWN)
    read_template("{if off}{local x = a}{endif}{x[a]}", "start_gcode").check(KNOWN)


def test_global_variables_go_on_from_macro_to_macro_and_local_ones_do_not() -> None:
    shared: dict[str, Value] = {}
    read_template("{global count = 1}{local own = 2}", "start_gcode").render(KNOWN, shared)
    (line,) = read_template("{count = count + 1}{count}", "layer_gcode").render(KNOWN, shared)

    assert line == "2"
    assert shared == {"count": 2}


def test_chance_is_the_same_each_time_and_stays_between_its_limits() -> None:
    macro = read_template("{random(1, 6)} {random(0.5, 1)}", "layer_gcode")
    drawn = [tuple(map(float, macro.render({"layer_num": n})[0].split())) for n in range(300)]

    assert drawn == [tuple(map(float, macro.render({"layer_num": n})[0].split())) for n in range(300)]
    assert {whole for whole, _ in drawn} == {1, 2, 3, 4, 5, 6}
    assert all(0.5 <= part <= 1 for _, part in drawn)


def test_lines_of_all_branches_that_may_be_taken() -> None:
    text = "{local x = 5}M104 S{if a > 1}{x}{elsif on}7{endif} ; end\n"
    text += "{if x > 9}never{elsif x == 5}M1{else}no{endif}\n{b}"

    assert read_template(text, "here").list_possible_lines({"b": 2.0}) == [
        "M104 S5",
        "M104 S7 ; end",
        "M1",
        "2",
    ]


def test_a_variable_that_a_branch_may_have_changed_decides_nothing() -> None:
    text = "{local x = 1}{if a > 1}{x = 2}{endif}{if x == 1}A{else}B{endif}"

    assert read_template(text, "here").list_possible_lines({}) == ["A", "B"]


# The names of other slicers

SLICED: dict[str, Value] = add_names_of_other_slicers(
    {
        "first_layer_nozzle_temperature": 215.0, "nozzle_temperature": 210.0, "bed_temperature": 60.0,
        "first_layer_bed_temperature": 65.0, "nozzle_diameter": 0.4, "bed_z": 200.0, "max_layer_z": 12.5,
        "first_layer_height": 0.3, "quality.layer_height": 0.2, "material.type": "PETG", "tool": 0.0, "model": "X1",
        "material_name": "Prusament PETG", "quality_name": "0.20mm QUALITY @MK3", "quality.speeds.travel": 150.0,
        "layer_count": 60, "layer_num": 59, "acceleration": 1250.0, "print_bed_max": (220.0, 210.0),
        "retract_length": 0.8, "has_wipe_tower": False,
    }
)  # fmt: skip


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("M104 S[first_layer_temperature]", "M104 S215"),
        ("M104 S{first_layer_temperature[0]}", "M104 S215"),
        ("M104 S[first_layer_temperature_0] T[initial_tool]", "M104 S215 T0"),
        ("M104 S{first_layer_temperature[initial_extruder]-15}", "M104 S200"),
        ("M104 S[first_layer_temperature[initial_tool]]", "M104 S215"),
        ("M104 S{temperature[0] * 0.791}", "M104 S166.11"),
        ("M104 S{temperature[0] / 4}", "M104 S52"),  # whole numbers divide to whole numbers
        ("M104 S{temperature[0] / 4.0}", "M104 S52.5"),
        ("M104 S{temperature[7]}", "M104 S210"),  # a vector that is too short gives its first item
        ("M104 S{int(temperature[0] * 0.5 + 0.6)} {round(2.5)} {-2.5}", "M104 S105 3 -2.5"),
        ("G1 Z{min(max_layer_z + 30, max_print_height)}", "G1 Z42.5"),
        ("G1 Z[first_layer_height] Y{print_bed_max[1]/2}", "G1 Z0.3 Y105"),
        ("M221 S{if layer_height<0.075}100{else}95{endif}", "M221 S95"),
        ("{if nozzle_diameter[0]==0.6}A{elsif nozzle_diameter[0]==0.4}B{else}C{endif}", "B"),
        ('{if filament_type[0]=="PETG"}A{else}B{endif}', "A"),
        ("{if filament_settings_id[initial_tool]=~/.*Prusament PA11.*/}A{else}B{endif}", "B"),
        ("{if print_settings_id=~/.*(DETAIL @MK3|QUALITY @MK3).*/}A{else}B{endif}", "A"),
        ("{if print_settings_id!~/0.20mm.*/}A{else}B{endif}", "B"),
        ("{if not has_wipe_tower}A{else}B{endif}", "A"),
        ('M403 F{"" + ((filament_type[0]=="FLEX") ? 1 : 2)}', "M403 F2"),
        ('M117 {"layers: " + total_layer_count}', "M117 layers: 60"),
        ('M862.3 P "[printer_model]"', 'M862.3 P "X1"'),
        ("F{travel_speed*60} [retract_length] [machine_max_acceleration_extruding]", "F9000 0.8 1250"),
        ("M117 {zdigits(layer_num, 3)}", "M117 059"),
        ("M104 S[nozzle_temperature_initial_layer]", "M104 S215"),  # OrcaSlicer
        ("M190 S[bed_temperature_initial_layer_single]", "M190 S65"),
        ("{if printable_height > 100}Z{max_layer_z + 1}{endif}", "Z13.5"),
        ("M104 S{material_print_temperature_layer_0[initial_extruder_nr]}", "M104 S215"),  # Cura
        ("M190 S{material_bed_temperature}", "M190 S60"),
    ],
)
def test_names_of_other_slicers_mean_what_they_mean_there(theirs: str, ours: str) -> None:
    assert read_template(theirs, "start_gcode").render(SLICED) == [ours]
