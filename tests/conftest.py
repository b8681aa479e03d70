"""Fixtures and Hypothesis profiles that all tests share.

`just check` runs the tests without the mark `thorough`, with the few examples of the profile `check`, the same every
time. `just thorough` runs all tests, with many examples drawn from one seed. Only a test that needs an exact number of
examples sets its own `max_examples`.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.database import DirectoryBasedExampleDatabase

EXAMPLES = Path(__file__).parents[1] / ".hypothesis" / "examples"
"""What random runs have found, tried again first; git ignores it."""

# How long an example takes says nothing of the code on a machine that others use, too.
settings.register_profile(
    "check",
    derandomize=True,
    max_examples=12,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile(
    "thorough",
    settings.get_profile("check"),
    derandomize=False,
    max_examples=200,
    database=DirectoryBasedExampleDatabase(EXAMPLES),
)
settings.load_profile("check")  # --hypothesis-profile thorough, as in `just thorough`, comes behind

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start would ignore it, too.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Else every process that a test starts would compile all that it imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# Nobody's own profiles; set before test modules ask what there is.
os.environ["PRINTER_SLICER_PROFILES"] = ""


@pytest.fixture(scope="session")
def shelves(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A new folder each time: quicker than to ask pytest for one, which looks through all that there are."""
    folder = tmp_path_factory.mktemp("shelves")
    return (folder / str(number) for number in count())


@pytest.fixture(autouse=True)
def own_job_store(shelves: Iterator[Path], monkeypatch: pytest.MonkeyPatch) -> Path:
    """Prints that a test leaves unfinished are nobody else's."""
    state = next(shelves)
    state.mkdir()
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(state))
    return state
