"""What all tests share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def shelf_of_its_own(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Prints that a test leaves unfinished are nobody else's."""
    state = tmp_path_factory.mktemp("state")
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(state))
    return state
