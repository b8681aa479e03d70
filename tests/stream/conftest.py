"""Run every conversation twice: in whole lines and byte by byte."""

from __future__ import annotations

import pytest


@pytest.fixture(params=[False, True], ids=["lines", "bytes"])
def bytewise(request: pytest.FixtureRequest) -> bool:
    """Whether the printer's answers arrive one byte at a time."""
    return bool(request.param)
