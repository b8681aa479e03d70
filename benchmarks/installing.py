"""Whether what is released can be installed: wheel and sdist, in fresh environments of every Python that is found.

    python benchmarks/installing.py [PYTHON ...]

Builds both from the files that git knows; then, for every Python of a version that we support: a new environment, the
wheel and nothing of the checkout, and the first command of the README, on parts that lie elsewhere. The sdist is
installed under one of them. Prints a table; the exit code says whether all of it went well.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST = 2 << 20  # bytes of a wheel
VERSIONS = ("3.11", "3.12", "3.13", "3.14")
PLAIN = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}


def pythons() -> Iterator[Path]:
    """One of each version: on the path, or where pyenv and uv keep them."""
    for version in VERSIONS:
        named = shutil.which(f"python{version}")
        places = [Path(named)] if named else []
        for folder in ("~/.pyenv/versions", "~/.local/share/uv/python"):
            places += sorted(Path(folder).expanduser().glob(f"*{version}.*/bin/python{version}"))
        for place in places:
            if said(place, "--version").startswith(f"Python {version}."):
                yield place
                break


def said(*command: object, cwd: Path | None = None) -> str:
    """What a command writes to stdout; empty if it fails."""
    done = subprocess.run([str(one) for one in command], capture_output=True, text=True, cwd=cwd, check=False)
    return done.stdout if done.returncode == 0 else ""


def run(*command: object, cwd: Path) -> str:
    """The same; an error if it fails."""
    words = [str(one) for one in command]
    done = subprocess.run(words, capture_output=True, text=True, cwd=cwd, env=PLAIN, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
    return done.stdout


def built(folder: Path) -> tuple[Path, Path]:
    """Wheel and sdist of the files that git knows, made by a fresh environment."""
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
    """Of the README, behind the name of the program."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = re.search(r"<!-- first run -->\n```sh\n.*printer-slicer (.*)\n", text)
    assert found, "the README has no first command"
    return found[1].split()


def tried(python: Path, package: Path, folder: Path) -> str:
    """Install a package under a Python and use it; the last thing that it says of the print."""
    home = folder / f"{python.name}-{package.suffix.strip('.')}"
    run(python, "-m", "venv", home, cwd=folder)
    inside = home / "bin"
    run(inside / "python", "-m", "pip", "install", "--quiet", package, cwd=folder)
    shutil.copytree(ROOT / "sample_parts", home / "sample_parts")
    shown = run(inside / "printer-slicer", *first_command(), cwd=home)
    run(inside / "printer-slicer", "profiles", cwd=home)
    place = run(inside / "python", "-c", "import printer_slicer; print(printer_slicer.__file__)", cwd=home)
    assert Path(place.strip()).is_relative_to(home), place
    return next(line for line in shown.splitlines() if line.startswith("executed")).partition("  ")[2].strip()


def main(chosen: Sequence[str]) -> int:
    """Build, install, print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel, sdist = built(folder)
        print(
            f"{wheel.name}: {wheel.stat().st_size / 1024:.0f} KiB; {sdist.name}: {sdist.stat().st_size / 1024:.0f} KiB"
        )
        found = [Path(one) for one in chosen] or list(pythons())
        for python in found:
            print(f"{said(python, '--version').strip():<16}wheel  {tried(python, wheel, folder)}", flush=True)
        print(f"{said(found[0], '--version').strip():<16}sdist  {tried(found[0], sdist, folder)}", flush=True)
        small = wheel.stat().st_size < MOST
    if not small:
        print(f"the wheel is larger than {MOST >> 20} MiB")
    return 0 if small else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
