"""The compiled kernel formats rows of moves as the Python code does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode.move_text import _Columns, _format_rows
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel

values = st.one_of(
    st.integers(-(10**7), 10**7), st.integers(-(2**62), 2**62), st.integers(-99, 99).map(lambda i: i * 1000)
)


def rows_with(kernel: str, codes: np.ndarray, columns: _Columns) -> tuple[bytes, list[int]]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        text, lengths = _format_rows(codes, columns)
    return text, lengths.tolist()


@needs_kernel
@given(st.data(), st.integers(0, 6))
def test_the_kernel_formats_the_same_rows(data: st.DataObject, n: int) -> None:
    codes = np.array(data.draw(st.lists(st.integers(0, 3), min_size=n, max_size=n)), np.uint8)
    columns: _Columns = [
        (
            name,
            np.array(data.draw(st.lists(values, min_size=n, max_size=n)), np.int64),
            decimals,
            np.array(data.draw(st.lists(st.booleans(), min_size=n, max_size=n)), np.bool_),
        )
        for name, decimals in ((b" X", 3), (b" Z", 4), (b" E", 5), (b" F", 0))
    ]

    assert rows_with("required", codes, columns) == rows_with("off", codes, columns)


@needs_kernel
def test_wrong_arrays_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    codes, two, four = np.zeros(2, np.uint8).data, np.zeros(2, np.int64).data, np.zeros(4, np.int64).data
    present = np.ones(2, np.bool_).data

    assert kernel.format_move_rows(codes, b"X\x03", two, present)[0] == b"G0 X0\nG0 X0\n"
    for arguments in (
        (codes, b"X", two, present),
        (codes, b"X\x03", four, present),
        (codes, b"X\x03", two, codes[:1]),
    ):
        with pytest.raises(ValueError, match="do not match"):
            kernel.format_move_rows(*arguments)
    with pytest.raises(ValueError, match="too many decimals"):
        kernel.format_move_rows(codes, b"X\x14", two, present)
