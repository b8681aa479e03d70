"""Whether the compiled kernel is installed, and where its results equal those of pyvoronoi to the last bit."""

from __future__ import annotations

import platform

import pytest

from printer_slicer.kernel import VARIABLE, describe_kernel

__all__ = ["KERNEL", "SAME_BITS", "needs_kernel"]

with pytest.MonkeyPatch.context() as patched:
    patched.delenv(VARIABLE, raising=False)
    KERNEL = describe_kernel()
    """`yes`, or `no` and the reason."""

needs_kernel = pytest.mark.skipif(KERNEL != "yes", reason=f"compiled kernel: {KERNEL}")

SAME_BITS = platform.machine() in {"x86_64", "AMD64"}
"""Elsewhere the compiler of pyvoronoi may join a multiplication and an addition, which then round once."""
