"""Read damaged files of every format: each must give a part or one of our errors, quickly and in little memory.

    python benchmarks/fuzz_input.py --inputs 120000

Every input is a small valid file and a seed. A finding names both; --only NAME --seed N repeats it. STEP needs a
separate process for each file, so it is tried a hundredth as often, and only if cascadio is installed.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "mesh_io")]

from mutations import damaged  # noqa: E402
from tiny_files import every_format  # noqa: E402
from tiny_step import step_box  # noqa: E402

from printer_slicer.errors import MeshError, UsageError  # noqa: E402
from printer_slicer.healing import repair  # noqa: E402
from printer_slicer.mesh_io import load_model  # noqa: E402

CPU_LIMIT = 5.0
"""CPU time limit for one input, s; valid files of this size take about a millisecond."""
MEMORY_LIMIT = 1 << 30
"""Memory limit of the process, in bytes beyond the memory mapped at the start."""


class TooLong(BaseException):
    """Raised at the time limit; not an Exception, so that no reader catches it."""


@contextmanager
def time_limit() -> Iterator[None]:
    """Raise TooLong if the work takes more CPU time than allowed."""

    def ring(_number: int, _frame: object) -> None:
        raise TooLong

    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, CPU_LIMIT)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


def read_outcome(path: Path) -> str:
    """Return the result of reading a file as a word; raise an error if the result is not acceptable."""
    try:
        with time_limit():
            mesh = load_model(path).mesh
    except (MeshError, UsageError) as error:
        if str(path) not in str(error) or not error.remedy:
            raise AssertionError(f"a message without file or remedy: {error}") from error
        if "MemoryError" in str(error) or "allocate" in str(error):
            raise AssertionError(f"stopped only by the limit of memory: {error}") from error
        return "refused"
    try:
        with time_limit():
            repair(mesh)
    except MeshError as error:
        if path.stem not in str(error) or not error.remedy:
            raise AssertionError(f"a message without part or remedy: {error}") from error
        return "read, not repaired"
    return "read"


def limit_memory() -> None:
    """Limit the memory of this process, so that a reader that requests more gets a MemoryError."""
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY_LIMIT, resource.RLIM_INFINITY))


def run(name: str, original: bytes, seeds: range, folder: Path) -> tuple[Counter[str], list[str]]:
    """Return outcomes and findings of one file with many seeds."""
    path, counts, findings = folder / f"part{Path(name).suffix}", Counter[str](), []
    for seed in seeds:
        path.write_bytes(damaged(original, seed))
        try:
            counts[read_outcome(path)] += 1
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - anything at all is what is looked for
            counts["found"] += 1
            findings.append(f"--only {name} --seed {seed}: {type(error).__name__}: {str(error)[:200]}")
            print(findings[-1], flush=True)
    return counts, findings


def main() -> int:
    """Read all damaged files and print the findings."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=120_000, help="total number of inputs, without STEP")
    parser.add_argument("--only", metavar="NAME", help="one file")
    parser.add_argument("--seed", type=int, help="a single seed, or the first one")
    parser.add_argument(
        "--traceback", action="store_true", help="with --only and --seed: print where the error occurs"
    )
    arguments = parser.parse_args()
    files = every_format() | ({"part.step": step_box(2, 3, 4).encode()} if find_spec("cascadio") else {})
    files = {name: data for name, data in files.items() if arguments.only in (None, name)}
    each = -(-arguments.inputs // max(len(files) - ("part.step" in files), 1))
    begun, total, found = time.process_time(), Counter[str](), 0
    with TemporaryDirectory(prefix="fuzz") as folder:
        for name, data in files.items():
            load_model(write(Path(folder), name, data))  # load the imports before memory is limited
        limit_memory()
        for name, data in files.items():
            count = each if not name.endswith("step") else max(each // 100, 1)
            seeds = range(
                arguments.seed or 0,
                (arguments.seed or 0) + (1 if arguments.only and arguments.seed is not None else count),
            )
            if arguments.traceback:
                read_outcome(write(Path(folder), name, damaged(data, seeds[0])))
            counts, findings = run(name, data, seeds, Path(folder))
            total += counts
            found += len(findings)
            print(f"{name:<14}{counts.total():>8} inputs, {dict(sorted(counts.items()))}", flush=True)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        f"{total.total()} inputs, {found} findings, {time.process_time() - begun:.0f} s CPU, {peak:.0f} MiB at most"
    )
    return 1 if found else 0


def write(folder: Path, name: str, data: bytes) -> Path:
    """Write a file and return its path."""
    path = folder / name
    path.write_bytes(data)
    return path


if __name__ == "__main__":
    raise SystemExit(main())
