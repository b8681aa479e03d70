"""Collect the fragments of changelog.d into a section of CHANGELOG.md: `just changelog VERSION`.

There is one fragment, a file, for each area, so that parallel changes do not conflict. It contains the headings `###
Added`, `### Changed`, `### Fixed` and `### Removed`, each with a list. At a release, the lists are joined under these
headings, the fragments are deleted, and an editor shortens the section.
"""

from __future__ import annotations

import argparse
import datetime as dt
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from printer_slicer.version import VERSION

ROOT: Final = Path(__file__).parents[1]
KINDS: Final = ("Added", "Changed", "Fixed", "Removed")


def main(argv: Sequence[str] | None = None, root: Path = ROOT) -> int:
    """Write the section of a version, or only show it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("version", help=f"of this release, as in printer_slicer/version.py: {VERSION}")
    parser.add_argument("--draft", action="store_true", help="print the section without changing files")
    options = parser.parse_args(argv)
    if options.version != VERSION:
        parser.error(
            f"the version is {VERSION}; change it in pyproject.toml, version.py and CITATION.cff first"
        )
    fragments = sorted((root / "changelog.d").glob("*.md"))
    text = section(options.version, {path.name: path.read_text(encoding="utf-8") for path in fragments})
    if options.draft:
        print(text)
        return 0
    changelog = root / "CHANGELOG.md"
    changelog.write_text(with_section(changelog.read_text(encoding="utf-8"), text), encoding="utf-8")
    for path in fragments:
        path.unlink()
    print(
        f"{changelog}: {options.version} with {len(text.split())} words; shorten the section to what users need"
    )
    return 0


def section(version: str, fragments: Mapping[str, str]) -> str:
    """Return the section of a version: the entries of all fragments (name -> text), under one heading for each kind.

    Raises:
        ValueError: there are no fragments, or one contains anything but lists under the known headings.
    """
    entries: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for name, text in fragments.items():
        before, *parts = re.split(r"^### (.*)\n", text, flags=re.MULTILINE)
        if before.strip() or not parts:
            raise ValueError(f"{name}: must start with one of ### {', '.join(KINDS)}")
        for kind, body in zip(parts[::2], parts[1::2], strict=True):
            if kind not in entries or not re.fullmatch(r"\s*(- .*\n(  .*\n)*\s*)+", body.rstrip() + "\n"):
                raise ValueError(f"{name}: ### {kind}: not a list, or not one of {', '.join(KINDS)}")
            entries[kind].append(body.strip())
    if not fragments:
        raise ValueError("changelog.d contains no fragments")
    lists = [f"### {kind}\n\n" + "\n".join(bodies) for kind, bodies in entries.items() if bodies]
    today = dt.datetime.now(dt.UTC).date()
    return "\n\n".join([f"## {version} ({today})", *lists]) + "\n"


def with_section(changelog: str, text: str) -> str:
    """Return the changelog with a section inserted before those of earlier versions."""
    head, mark, rest = changelog.partition("\n## ")
    if rest.startswith(text.split()[1] + " "):
        raise ValueError(f"there is a section {text.split()[1]} already")
    return f"{head}\n{text}{mark}{rest}" if mark else f"{head.rstrip()}\n\n{text}"


if __name__ == "__main__":
    raise SystemExit(main())
