"""Memory of arrays stays with the process once it was asked to keep it."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

from printer_slicer.freed_memory import load_c_library, release_freed_memory

SCRIPT = """
import resource, sys
import numpy as np
from printer_slicer.freed_memory import keep_freed_memory

if sys.argv[1] == "keep":
    keep_freed_memory()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.full(50_000_000, 1, np.uint8)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_arrays_made_again_and_again_ask_the_system_once() -> None:
    faults = {
        kind: int(subprocess.check_output([sys.executable, "-c", SCRIPT, kind], text=True))
        for kind in ("keep", "hand_back")
    }

    assert 5 * faults["keep"] < faults["hand_back"]


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_the_c_library_is_loaded_once() -> None:
    for _ in range(3):
        release_freed_memory()

    assert load_c_library.cache_info().misses <= 1
    assert load_c_library().mallinfo2().freed >= 0
