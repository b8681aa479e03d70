"""Runs of elements that are read at once are read as the parser reads them one by one."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import MeshError
from printer_slicer.kernel import VARIABLE
from printer_slicer.mesh_io.element_runs import ElementRun
from printer_slicer.mesh_io.limits import Limits
from printer_slicer.mesh_io.markup import XmlReader, get_integer
from tests.kernels import needs_kernel

ELEMENTS = [
    '<v a="1" b="2"/>',
    '<v a="3"  b="4" />',
    '\n\t<v\n a="-5" b="6"/>',
    '<v b="7" a="8"/>',
    "<v a='9' b='10'/>",
    '<v a="11" b="12"></v>',
    '<v a="13" b="14" c="/>"/>',
    '<v a="&#49;5" b="16"/>',
    '<v a="1_7" b=" 18 "/>',
    '<v a="x" b="19"/>',
    '<v a="20"/>',
    '<w a="21" b="22"/>',
    '<!-- <v a="23" b="24"/> -->',
    '<!-- <vs><v a="25" b="26"/>',
    "-->",
    '<![CDATA[<v a="27" b="28"/>]]>',
    '<?x <v a="29" b="30"/>?>',
    "</vs><vs>",
    '</vs>\n<vs ><v a="31" b="32"/></vs><vs>',
    "text",
    '<v a="33" b="34"/',
]


class Reader(XmlReader):
    """Collects the attributes of all elements `v`, and how many of them were in a run."""

    def __init__(self, *, runs: bool) -> None:
        super().__init__(Path("x.xml"), Limits())
        self.values: list[int] = []
        self.n_in_runs = 0
        self.register(["v"], self._add)
        if runs:
            self.register_run([""], ElementRun("vs", "v", ("a", "b"), "q", self._add_all))

    def _add(self, attributes: list[str]) -> None:
        self.values += [get_integer(attributes, name) for name in "ab"]

    def _add_all(self, values: array[int]) -> None:
        self.values += values
        self.n_in_runs += len(values) // 2


def result_of(text: str, size: int, *, runs: bool) -> tuple[list[int], str]:
    reader, data = Reader(runs=runs), text.encode()
    try:
        reader.read(data[i : i + size] for i in range(0, len(data), size))
    except MeshError as error:
        return [], str(error).partition("\n")[0].partition(", column")[
            0
        ]  # columns do not count elements of a run
    return reader.values, ""


@given(st.lists(st.sampled_from(ELEMENTS[:1] * 9 + ELEMENTS), max_size=14), st.integers(1, 90))
def test_elements_are_read_as_by_the_parser_in_pieces_of_any_size(elements: list[str], size: int) -> None:
    text = f"<m>\n <vs>{''.join(elements)}\n</vs></m>"

    assert result_of(text, size, runs=True) == result_of(text, size, runs=False)


def test_plain_elements_do_not_pass_through_the_parser() -> None:
    plain = "\n".join(f'<v a="{i}" b="{i * i}" />' for i in range(200))
    data = f"<m>\n <vs>\n{plain}\n</vs>\n<vs>{plain}<v a='1' b='2'/>{plain}</vs></m>".encode()
    for size in (100, 1000, len(data)):
        reader = Reader(runs=True)
        reader.read(data[i : i + size] for i in range(0, len(data), size))

        assert len(reader.values) == 2 * 601
        assert reader.n_in_runs >= (200 if size == len(data) else 550)


def test_errors_after_a_run_name_their_line() -> None:
    text = "<m>\n<vs>\n" + '<v a="1" b="2"/>\n' * 5 + "<v/>\n</vs></m>"
    for size in (7, 1000):
        assert result_of(text, size, runs=True) == ([], "x.xml: line 8: the attribute 'a' is missing")


# The compiled kernel

digits = st.text("0123456789", max_size=24)
numbers = st.one_of(
    st.floats().map(repr),
    st.floats(-300, 300, width=32).map(lambda value: f"{value:.6g}"),
    st.integers().map(str),
    st.tuples(st.sampled_from(["", "-", "+", " "]), digits, st.sampled_from(["", "."]), digits).map("".join),
    st.tuples(st.sampled_from(["1", "-0", "9007199254740993", "5.", ".25"]), st.integers(-400, 400)).map(
        lambda pair: f"{pair[0]}e{pair[1]}"
    ),
    st.sampled_from(["", "-", ".", "1_0", "0x1", "inf", "1e", "1e+", "2E-5", "1.5 ", "-0.0", "9" * 400]),
)


def read_with(kernel: str, text: bytes, kind: str) -> tuple[bytes, str]:
    """The bytes of the values of elements `v`, and the error."""
    values: list[array[Any]] = []
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        try:
            is_run = ElementRun("vs", "v", ("a", "b"), kind, values.append).read(text)
        except OverflowError as error:
            return b"", str(error)
    return b"".join(one.tobytes() for one in values), "" if is_run else "no run"


@needs_kernel
@given(
    st.lists(st.tuples(numbers, numbers), min_size=1, max_size=4),
    st.sampled_from(['<v a="{}" b="{}"/>', '\t<v  a="{}"\r\nb="{}" />\n', '<v a="{}"b="{}"/>']),
    st.sampled_from("dq"),
)
def test_the_kernel_reads_the_same_bits(pairs: list[tuple[str, str]], form: str, kind: str) -> None:
    text = "".join(form.format(*pair) for pair in pairs).encode()

    assert read_with("required", text, kind) == read_with("off", text, kind)


@needs_kernel
@given(st.text(' <v/>ab="1.\n', max_size=40), st.sampled_from("dq"))
def test_the_kernel_recognises_no_other_text(text: str, kind: str) -> None:
    for whole in (text, f'<v a="1" b="2"/>{text}'):
        assert read_with("required", whole.encode(), kind) == read_with("off", whole.encode(), kind)
