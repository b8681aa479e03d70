"""Test the installation of a release: wheel and sdist, in a new environment of every Python that is found.

    python benchmarks/installing.py [PYTHON ...]

Both are built from the files in git. Then, for every supported version of Python, the wheel is installed in a new
environment without access to the checkout, and the first command of the README runs on parts in another folder. The
sdist is installed with one of these versions, and once more where no C++ compiler is found. The output is a table; the
exit code is 0 if everything succeeded.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

ROOT = Path(__file__).parents[1]
MOST = 2 << 20  # largest size of a wheel, bytes
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
PLAIN = {
    name: value
    for name, value in os.environ.items()
    if not name.startswith("PYTHON") and name != "PRINTER_SLICER_KERNEL"
}
NO_COMPILER = {"CC": "no-compiler", "CXX": "no-compiler"}


def find_pythons() -> Iterator[Path]:
    """Return one interpreter of each version: on the path, or in the folders of pyenv and uv."""
    for version in VERSIONS:
        named = shutil.which(f"python{version}")
        places = [Path(named)] if named else []
        for folder in ("~/.pyenv/versions", "~/.local/share/uv/python"):
            places += sorted(Path(folder).expanduser().glob(f"*{version}.*/bin/python{version}"))
        for place in places:
            if read_stdout(place, "--version").startswith(f"Python {version}."):
                yield place
                break


def read_stdout(*command: object, cwd: Path | None = None) -> str:
    """Return the stdout of a command; empty if it fails."""
    done = subprocess.run([str(one) for one in command], capture_output=True, text=True, cwd=cwd, check=False)
    return done.stdout if done.returncode == 0 else ""


def run(*command: object, cwd: Path, variables: Mapping[str, str] = MappingProxyType({})) -> str:
    """Run a command, with more environment variables, and return its stdout; exit with an error if it fails."""
    words = [str(one) for one in command]
    done = subprocess.run(
        words, capture_output=True, text=True, cwd=cwd, env={**PLAIN, **variables}, check=False
    )
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def build_packages(folder: Path) -> tuple[Path, Path]:
    """Build wheel and sdist from the files in git, in a new environment."""
    source = folder / "source"
    source.mkdir()
    names = run("git", "ls-files", "-z", cwd=ROOT).split("\0")
    for name in filter(None, names):
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    run(sys.executable, "-m", "venv", folder / "builder", cwd=folder)
    python = folder / "builder" / "bin" / "python"
    run(python, "-m", "pip", "install", "--quiet", "build", cwd=folder)
    run(python, "-m", "build", "--outdir", folder / "dist", source, cwd=folder)
    (wheel,), (sdist,) = ((folder / "dist").glob(kind) for kind in ("*.whl", "*.tar.gz"))
    return wheel, sdist


def first_command() -> list[str]:
    """Return the first command of the README, without the name of the program."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"<!-- first run -->\n```sh\n.*printer-slicer (.*)\n", text)
    assert found, "the README has no first command"
    return found[1].split()


def try_package(python: Path, package: Path, folder: Path, *, compiler: bool = True) -> str:
    """Install a package under a Python, run it, and return a line of its output, and whether it has the kernel."""
    home = folder / f"{python.name}-{package.suffix.strip('.')}-{compiler}"
    run(python, "-m", "venv", home, cwd=folder)
    inside = home / "bin"
    install = (inside / "python", "-m", "pip", "install", "--quiet", "--no-cache-dir", package)
    run(*install, cwd=folder, variables={} if compiler else NO_COMPILER)
    shutil.copytree(ROOT / "sample_parts", home / "sample_parts")
    shown = run(inside / "printer-slicer", *first_command(), cwd=home)
    run(inside / "printer-slicer", "profiles", cwd=home)
    place = run(inside / "python", "-c", "import printer_slicer; print(printer_slicer.__file__)", cwd=home)
    assert Path(place.strip()).is_relative_to(home), place
    kernel = run(inside / "printer-slicer", "--version", cwd=home).splitlines()[1]
    assert compiler or kernel == "compiled kernel: no (no C++ compiler when installed)", kernel
    executed = next(line for line in shown.splitlines() if line.startswith("executed"))
    return f"{executed.partition('  ')[2].strip()}  {kernel}"


def main(chosen: Sequence[str]) -> int:
    """Build, install, and print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel, sdist = build_packages(folder)
        print(
            f"{wheel.name}: {wheel.stat().st_size / 1024:.0f} KiB; {sdist.name}: {sdist.stat().st_size / 1024:.0f} KiB"
        )
        found = [Path(one) for one in chosen] or list(find_pythons())
        for python in found:
            print(
                f"{read_stdout(python, '--version').strip():<16}wheel  {try_package(python, wheel, folder)}",
                flush=True,
            )
        print(
            f"{read_stdout(found[0], '--version').strip():<16}sdist  {try_package(found[0], sdist, folder)}",
            flush=True,
        )
        alone = try_package(found[0], sdist, folder, compiler=False)
        print(f"{read_stdout(found[0], '--version').strip():<16}sdist  {alone}", flush=True)
        small = wheel.stat().st_size < MOST
    if not small:
        print(f"the wheel is larger than {MOST >> 20} MiB")
    return 0 if small else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
