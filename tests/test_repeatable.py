"""What fails can be repeated: the examples of property tests are the same in every run, random ones are kept."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from hypothesis import settings

from tests.conftest import EXAMPLES
from tests.waiting import LAST_RESORT

ROOT = Path(__file__).parents[1]
FAILS = """
from hypothesis import given, strategies as st

tried = []

@given(st.integers())
def test_all_numbers_are_small(number):
    tried.append(number)
    assert number < 1000

def test_tell():
    print("tried", tried)
    assert False
"""


def run(folder: Path, *flags: str) -> str:
    """What pytest says about a property that does not hold."""
    (folder / "test_fails.py").write_text(FAILS, encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "tests.conftest",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
    ]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [*command, *flags, "test_fails.py"],
        cwd=folder,
        env=env,
        capture_output=True,
        text=True,
        timeout=LAST_RESORT,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


def tried(said: str) -> str:
    (line,) = re.findall(r"^tried .*", said, flags=re.MULTILINE)
    return str(line)


def test_every_run_tries_the_same_examples_and_says_how_to_repeat_a_failure(tmp_path: Path) -> None:
    one, other = run(tmp_path), run(tmp_path)

    assert tried(one) == tried(other)
    assert "@reproduce_failure(" in one


def test_random_runs_try_others_and_keep_what_fails_where_git_does_not_look() -> None:
    random = settings.get_profile("thorough")
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()

    assert not random.derandomize
    assert random.print_blob
    assert str(EXAMPLES) in repr(random.database)
    assert f"{EXAMPLES.relative_to(ROOT).parts[0]}/" in ignored
