"""Runs of elements that are read at once are read as the parser reads them one by one."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.element_runs import ElementRun
from printer_slicer.mesh_io.limits import Limits
from printer_slicer.mesh_io.markup import XmlReader, get_integer

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
            self.register_run([""], ElementRun("vs", "v", ("a", "b"), self._add_all))

    def _add(self, attributes: list[str]) -> None:
        self.values += [get_integer(attributes, name) for name in "ab"]

    def _add_all(self, values: list[bytes]) -> None:
        self.values += [int(value) for value in values]
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
