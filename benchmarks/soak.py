"""Print very many lines over a pseudo-terminal, and measure memory and time of the host.

    python benchmarks/soak.py --lines 1000000

Host and simulated printer are separate processes, and the printer never makes the host wait. The output gives the
resident memory of the host after a tenth of the lines and at the end, lines per second, and the CPU time of the host.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic

ROOT = Path(__file__).parents[1]


def resident_memory(pid: int) -> int:
    """Return the resident memory of a process, kB."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    return 0


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process, s."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def command(*arguments: str) -> list[str]:
    """Return our command line."""
    return [sys.executable, "-m", "printer_slicer", *arguments]


def soak(lines: int, folder: Path) -> tuple[list[tuple[int, int]], float, float, int]:
    """Return (lines done, resident kB) at each hundredth, s, CPU s, exit code."""
    text = "G28\nG90\nM83\n" + "".join(
        f"G1 X{50 + n % 97 * 0.5:.1f} Y{50 + n % 89 * 0.5:.1f} F9000\n" for n in range(lines)
    )
    (folder / "job.gcode").write_text(text, encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PRINTER_SLICER_STATE": str(folder / "state")}
    seen: list[tuple[int, int]] = []
    with subprocess.Popen(
        command("sim", "--pty", "port", "--speed", "0"), cwd=folder, env=env, stdout=subprocess.PIPE
    ) as printer:
        assert printer.stdout is not None
        printer.stdout.readline()
        host = subprocess.Popen(
            command("print", "job.gcode", "--port", "port", "--json", "--set", "printer.baud=1000000"),
            cwd=folder,
            env=env,
            stdout=subprocess.PIPE,
        )
        assert host.stdout is not None
        begun, taken = 0.0, 0.0
        for line in host.stdout:
            event = json.loads(line)
            if event["event"] == "progress":
                begun = begun or monotonic()
                seen.append((event["done"], resident_memory(host.pid)))
                taken = cpu_seconds(host.pid) if event["done"] < event["total"] else taken
        seconds = monotonic() - begun
        printer.terminate()
        return seen, seconds, taken, host.wait()


def main() -> int:
    """Print how the memory grew."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--lines", type=int, default=1_000_000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seen, seconds, taken, code = soak(arguments.lines, Path(folder))
    early = next(kilobytes for done, kilobytes in seen if done >= arguments.lines // 10)
    last = seen[-1][1]
    print(f"{seen[-1][0]} lines in {seconds:.0f} s ({seen[-1][0] / seconds:.0f}/s), exit code {code}")
    print(
        f"host: {taken:.0f} s of CPU time including the start; {early} kB after a tenth, {last} kB at the end: "
        f"+{last - early} kB"
    )
    return 0 if code == 0 and last - early <= 5 * 1024 else 1


if __name__ == "__main__":
    sys.exit(main())
