"""What all tests share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# How long an example takes says nothing of the code on a machine that others use, too.
settings.register_profile("shared machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("shared machine")

# Nobody's own profiles; set before test modules ask what there is.
os.environ["PRINTER_SLICER_PROFILES"] = ""


@pytest.fixture(autouse=True)
def shelf_of_its_own(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Prints that a test leaves unfinished are nobody else's."""
    state = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(state))
    return state
