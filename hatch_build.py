"""Compile the kernel when a wheel is built or the checkout is installed; without a compiler, go on without the kernel.

The wheel with the kernel is for one platform and all versions of CPython from 3.11 on, the wheel without it for all
platforms. The reason for a missing kernel goes into printer_slicer/_kernel.txt, and `printer-slicer --version` prints
it. If the environment variable PRINTER_SLICER_KERNEL is `off`, the kernel is not compiled; if it is `required`, an
installation without the kernel fails.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "PRINTER_SLICER_KERNEL"
PYTHON = (3, 11)  # the oldest version whose limited API the kernel uses
# Boost relies on the rounding of each operation, so none may be contracted or reordered.
FLAGS = ["-std=c++17", "-O2", "-ffp-contract=off", "-fno-fast-math", "-fvisibility=hidden", "-g0"]
FLAGS_MSVC = ["/std:c++17", "/O2", "/fp:precise", "/EHsc"]


class NoKernelError(Exception):
    """The kernel cannot be compiled; the message is the reason."""


class CustomBuildHook(BuildHookInterface[Any]):
    """Adds the compiled kernel to the wheel, or puts it into the checkout for an editable installation."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernel before the files are collected; `version` is `standard` or `editable`."""
        self.folder = Path(tempfile.mkdtemp())
        try:
            result = compile_kernel(Path(self.root, "kernel"), self.folder)
        except NoKernelError as error:
            if os.environ.get(VARIABLE) == "required":
                shutil.rmtree(self.folder)
                sys.exit(f"no compiled kernel: {error}")
            self.app.display_warning(f"continuing without the compiled kernel: {error}")
            result = self.folder / "_kernel.txt"
            result.write_text(f"{error}\n", encoding="utf-8")
        if version == "editable":
            for old in Path(self.root, "printer_slicer").glob("_kernel.*"):
                old.unlink()
            shutil.copy(result, Path(self.root, "printer_slicer"))
            return
        build_data["force_include"][str(result)] = f"printer_slicer/{result.name}"
        if result.suffix != ".txt":
            platform = self.build_config.builder.get_best_matching_tag().rpartition("-")[2]
            build_data["pure_python"] = False
            build_data["tag"] = f"cp{PYTHON[0]}{PYTHON[1]}-abi3-{platform}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove what was compiled."""
        shutil.rmtree(self.folder)


def compile_kernel(source: Path, folder: Path) -> Path:
    """Compile the module into a folder, and return its file.

    Raises:
        NoKernelError: PRINTER_SLICER_KERNEL is `off`, there is no compiler, Python has no headers or no limited API, or
            the compiler fails.
    """
    if os.environ.get(VARIABLE) == "off":
        raise NoKernelError(f"{VARIABLE} was off when installed")
    if sys.implementation.name != "cpython" or sysconfig.get_config_var("Py_GIL_DISABLED"):
        raise NoKernelError("this kind of Python has no limited API")
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        raise NoKernelError("Python's headers were missing when installed")
    if (
        sys.platform == "darwin"
        and subprocess.run(["/usr/bin/xcode-select", "-p"], capture_output=True, check=False).returncode
    ):
        raise NoKernelError("no C++ compiler when installed")  # calling it would open a window
    try:
        from setuptools import Distribution, Extension  # noqa: PLC0415 - may be missing
        from setuptools.command.build_ext import build_ext  # noqa: PLC0415
    except ImportError:
        raise NoKernelError("setuptools was missing when installed") from None
    module = Extension(
        "_kernel",
        sorted(str(file) for file in source.glob("*.cpp")),
        include_dirs=[str(source), str(source / "standard")],
        define_macros=[("Py_LIMITED_API", f"0x{PYTHON[0]:02X}{PYTHON[1]:02X}0000")],
        extra_compile_args=FLAGS_MSVC if sys.platform == "win32" else FLAGS,
        language="c++",
        py_limited_api=True,
    )
    command = build_ext(Distribution({"name": "kernel", "ext_modules": [module]}))
    command.build_lib, command.build_temp = str(folder), str(folder / "objects")
    try:
        command.ensure_finalized()
        command.run()
    except Exception as error:  # every compiler has errors of its own
        raise NoKernelError(explain(command, error)) from error
    return Path(command.get_ext_fullpath("_kernel"))


def explain(command: Any, error: Exception) -> str:
    """Return in a few words why the compiler failed."""
    compiler = getattr(command.compiler, "compiler_so_cxx", None) or getattr(
        command.compiler, "compiler_so", None
    )
    if "Microsoft Visual C++" in str(error) or (compiler and not shutil.which(compiler[0])):
        return "no C++ compiler when installed"
    return "the C++ compiler failed when installed"
