"""The language of macros: expressions have the values that another evaluator finds; garbage gives text or an error."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.errors import ProfileError
from printer_slicer.macros import Value, number, read_template, text_of

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
    return "\n".join(read_template(text, "start_gcode").filled(KNOWN))


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
        "/": lambda: a / b if b else None,
    }[sign]()
    large = isinstance(compared, float) and abs(compared) > 1e15
    return Case(text, None if large else compared)


def choice(condition: Case, yes: Case, no: Case) -> Case:
    chosen = None if condition.value is None else yes.value if condition.value else no.value
    return Case(f"({condition.text} ? {yes.text} : {no.text})", chosen)


def call(name: str, arguments: list[Case]) -> Case:
    values = [one.value for one in arguments]
    text = f"{name}({', '.join(one.text for one in arguments)})"
    return Case(text, None if either(*values) else {"min": min, "max": max}[name](values))


LITERALS = st.one_of(
    st.integers(0, 999).map(lambda n: Case(str(n), float(n))),
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
@settings(max_examples=300)
def test_an_expression_has_the_value_that_another_evaluator_finds(case: Case) -> None:
    if case.value is None or len(case.text) > 400:
        return  # no value, or longer than what is read

    assert made(f"{{{case.text}}}") == text_of(case.value)


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
@settings(max_examples=500)
def test_garbage_gives_text_or_an_error_that_says_where(text: str) -> None:
    try:
        lines = read_template(text, "start_gcode").filled(KNOWN)
    except ProfileError as error:
        place = str(error).splitlines()
        assert place[0].startswith("start_gcode: line ")
        assert place[2].strip() == "^"
    else:
        assert all(isinstance(line, str) for line in lines)


@given(
    st.text(
        alphabet=st.characters(exclude_characters="\n\r\x0b\x0c\x1c\x1d\x1e\x85\u2028\u2029"), max_size=50
    )
)
def test_doubled_braces_stand_for_themselves(text: str) -> None:
    assert made("x" + text.replace("{", "{{").replace("}", "}}")) == "x" + text


@given(st.floats(-1e9, 1e9))
def test_numbers_have_no_exponent_and_no_needless_zeros(value: float) -> None:
    text = number(value)

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
        ("{-7 % 3} {0.6 % 0.2}", "2 0"),
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
        ("{if off}\n{nozle_temperature}\n{endif}", 2, 2, ["{nozzle_temperature}"]),
        ("G1 X{1 / (a - 3)}", 1, 8, ["division by zero"]),
        ("{1 % 0}", 1, 4, ["division by zero"]),
        ("{a + name}", 1, 4, ["a number + a text", "text(x)"]),
        ("{on + 1}", 1, 5, ["yes or no + a number"]),
        ("{on < off}", 1, 5, ["yes or no < yes or no"]),
        ("{tops + 1}", 1, 7, ["a list + a number"]),
        ("{-name}", 1, 3, ["a number was expected", "a text"]),
        ("{if a}\n{endif}", 1, 5, ["a number is no condition"]),
        ("{name ? 1 : 2}", 1, 2, ["a text is no condition"]),
        ("{tops[3]}", 1, 7, ["no item 3", "list of 3"]),
        ("{tops[0.5]}", 1, 7, ["whole number"]),
        ("{a[0]}", 1, 3, ["a number has no items"]),
        ("{flor(1)}", 1, 2, ["unknown function flor()", "floor()"]),
        ("{sqrt(-1)}", 1, 2, ["no square root"]),
        ("{round(1, 2, 3)}", 1, 2, ["takes 1 or 2, got 3"]),
        ("{fixed(1, 0.5)}", 1, 2, ["number of digits"]),
        ("{a b}", 1, 4, ["'b'", "operator"]),
        ("{a +}", 1, 5, ["end of the expression", "a value"]),
        ("{(a}", 1, 4, ["end of the expression", ")"]),
        ("{a = 3}", 1, 4, ["write =="]),
        ("{1 < a < 4}", 1, 8, ["chains"]),
        ("{a; b}", 1, 3, ["';'"]),
        ("{'open}", 1, 2, ["does not end"]),
        ("{}", 1, 2, ["nothing between"]),
        ("a { b", 1, 3, ["without its partner"]),
        ("a } b", 1, 3, ["without its partner", "}}"]),
        ("{if on}\nG28", 1, 1, ["without {endif}"]),
        ("{if on}\n{if off}\n{endif}\nG28", 1, 1, ["without {endif}"]),
        ("{endif}", 1, 1, ["without {if"]),
        ("{if on}{else}\n{elif on}{endif}", 2, 1, ["behind {else}"]),
        ("{if}{endif}", 1, 4, ["without a condition"]),
        ("{if on}{else on}{endif}", 1, 14, ["nothing may follow"]),
        ("{if on}{elsif on}{endif}", 1, 9, ["{elif"]),
        ("{1e200}", 1, 2, ["beyond"]),
        ("{1e10 * 1e10}", 1, 7, ["beyond"]),
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
    _, shown, mark = str(refused("; " + "x" * 500 + "{nope}" + "y" * 500)).splitlines()[:3]

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

    with pytest.raises(ProfileError, match="characters come out"):
        read_template("{long}" * 1001, "start_gcode").filled(known)
