"""Layer plans of every planner and of other slicers, by one judge: deviation of the surface against minutes.

    python -m benchmarks.planning [--models DIR] [--printer NAME] [--heights THIN THICK] [part ...]

All plans of a part are scored by the same functions: the time of our toolpaths over them, the distance of points on
the part from the stack that would be printed, the certified error and volume error, flats and part height. Of peers the
time of their own G-code on our machine model is shown as well, and the time of PrusaSlicer's toolpaths over our plans.
Results go to `benchmarks/made/`: the figures as JSON, a picture for each part, and the peers' G-code, which is used
again as long as part, profile and peer stay the same.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.curves import Row, draw
from benchmarks.match import Match, match
from benchmarks.peers import CuraEngine, Part, PrusaSlicer, find_peers
from benchmarks.processes import SAMPLES, WORK, RunError, machine_note
from benchmarks.reports import BASES, judgement, match_table, part_table, plan_table, ratio_table
from benchmarks.scoring import Judge
from benchmarks.sizes import printable
from benchmarks.sweeps import attempts, our_row, peer_attempts, peer_row
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.placing import place
from printer_slicer.profile import Profile, load_profile


@dataclass(slots=True)
class Result:
    """What came out for one part.

    Attributes:
        name: of the part.
        rows: all plans.
        matches: peers' plans against ours on the peers' terms.
        failures: a line for everything that did not work.
    """

    name: str
    rows: list[Row] = field(default_factory=list)
    matches: list[Match] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; 1 if a part could not be measured."""
    options = _options(argv)
    models = _models(options.models, options.parts)
    folder = WORK / "planning"
    folder.mkdir(parents=True, exist_ok=True)
    changes = {
        "quality.thinnest_layer": options.heights[0],
        "quality.thickest_layer": options.heights[1],
        "quality.planner.kind": "uniform",
    }
    profile = load_profile(options.printer, options.material, "standard", changes)
    prusa, cura, absent = find_peers()
    names = [peer.name for peer in (prusa, cura) if peer]
    note = (
        f"{machine_note()}; {', '.join(names) or 'no peers'}; {profile.printer.name}, {profile.material.name}"
    )
    print("\n".join([note, *absent]), flush=True)
    results = []
    for path in models:
        results.append(_measure(path, profile, folder, (prusa, cura), options))
        _show(results[-1])
    print("\nOurs by theirs, all parts\n")
    print(part_table([(result.name, result.rows, result.matches) for result in results]))
    print("\n" + judgement([(result.rows, result.matches) for result in results]))
    target = options.json or WORK / "planning.json"
    target.write_text(
        json.dumps({"note": note, "parts": [_plain(result) for result in results]}, indent=1) + "\n"
    )
    print(f"figures: {target}")
    return int(any(not result.rows for result in results))


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.planning",
        description="Layer plans of every planner and of other slicers, by one judge.",
    )
    add = parser.add_argument
    add("parts", nargs="*", help="files, or names without extension; default: all sample parts and models")
    add("--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)")
    add("--printer", help="printer profile, whose machine all minutes are for")
    add("--material", help="material profile")
    add(
        "--heights",
        type=float,
        nargs=2,
        default=(0.1, 0.3),
        metavar=("THIN", "THICK"),
        help="mm (default 0.1 0.3)",
    )
    add("--points", type=int, default=20_000, help="points on each part (default 20000)")
    add("--quick", action="store_true", help="only the optimal planner and the peers' usual settings")
    add("--no-feed", action="store_true", help="do not let PrusaSlicer print our plans")
    add("--no-match", action="store_true", help="do not look for the fewest layers at the peers' errors")
    add("--json", type=Path, metavar="FILE", help="where to write the figures")
    options = parser.parse_args(argv)
    if options.models is None and os.environ.get("PRINTER_SLICER_MODELS"):
        options.models = Path(os.environ["PRINTER_SLICER_MODELS"])
    if options.models is not None and not options.models.is_dir():
        parser.error(f"--models {options.models}: no such folder")
    return options


def _models(models: Path | None, wanted: Sequence[str]) -> list[Path]:
    """The files to measure."""
    known: dict[str, Path] = {}
    for folder in (models, SAMPLES):
        for path in sorted(folder.iterdir()) if folder else []:
            if path.suffix.lower().removeprefix(".") in FORMATS:
                known.setdefault(path.stem, path)
    found = [known[name] if name in known else Path(name) for name in wanted or known]
    missing = [str(path) for path in found if not path.is_file()]
    if missing:
        sys.exit(f"no part {', '.join(missing)}; there are {', '.join(known)}")
    return found


# Measuring


def _measure(
    path: Path,
    profile: Profile,
    folder: Path,
    peers: tuple[PrusaSlicer | None, CuraEngine | None],
    options: argparse.Namespace,
) -> Result:
    """All plans of one part; what fails is told and left out."""
    result = Result(path.stem)
    try:
        part = Part(place(_sized(result, load_mesh(path)), profile.printer), profile, folder)
    except PrinterSlicerError as error:
        _told(result, f"{path.stem}: {error}")
        return result
    judge, prusa = Judge(part, options.points), peers[0]
    for family, run in peer_attempts(part, *peers, quick=options.quick):
        _try(result, family, lambda family=family, run=run: peer_row(judge, family, run()))  # type: ignore[misc]
    fed = None if options.no_feed else prusa
    for attempt in attempts(part, quick=options.quick):
        _try(result, attempt.family, lambda attempt=attempt: our_row(judge, attempt, fed))  # type: ignore[misc]
    for row in [] if options.no_match else _different(result.rows):
        print(f"{result.name}: matching {row.family} {row.setting}", file=sys.stderr, flush=True)
        result.matches.append(match(judge, row))
    return result


def _sized(result: Result, mesh: Mesh) -> Mesh:
    """The mesh, large enough to print."""
    sized, told = printable(mesh)
    if told:
        _told(result, told)
    return sized


def _different(rows: Sequence[Row]) -> list[Row]:
    """The rows of peers, one for each plan: uniform layers are the same for all."""
    return list({row.plan.top.tobytes(): row for row in reversed(rows) if not row.ours}.values())[::-1]


def _try(result: Result, family: str, make: Callable[[], Row]) -> None:
    """Add a row if it can be had."""
    try:
        row = make()
    except (PrinterSlicerError, RunError) as error:
        _told(result, f"{result.name}: {family}: {error}")
        return
    result.rows.append(row)
    score = row.score
    print(
        f"{result.name}: {family} {row.setting}: {score.layers} layers, {score.minutes:.1f} min, "
        f"{1e3 * score.mean:.2f} µm",
        file=sys.stderr,
        flush=True,
    )


def _told(result: Result, line: str) -> None:
    result.failures.append(line)
    print(line, file=sys.stderr, flush=True)


# Saying it


def _show(result: Result) -> None:
    """The tables of one part, and its picture."""
    print("\n".join(["", f"## {result.name}", "", *result.failures]))
    if not result.rows:
        return
    print("\n\n".join(_tables(result)), flush=True)
    picture = WORK / f"planning_{result.name}.svg"
    panels = [(name, minutes) for name, minutes in BASES]
    picture.write_text(draw(f"{result.name}: mean deviation of the surface", result.rows, panels), "utf-8")
    print(f"\npicture: {picture}", flush=True)


def _tables(result: Result) -> Iterator[str]:
    yield plan_table(result.rows)
    error = max(row.score.standard_error for row in result.rows)
    yield f"Distances in µm; by the choice of the points the means have a standard error of at most {1e3 * error:.2f}."
    strayed = [row.strayed for row in result.rows if row.strayed is not None]
    if strayed:
        dropped = max(row.dropped or 0 for row in result.rows)
        yield (
            f"PrusaSlicer laid the layers of {len(strayed)} of our plans within {1e3 * max(strayed):.2f} µm of their "
            f"heights and left out {dropped} of one plan at most."
        )
    for name, minutes in BASES:
        table = ratio_table(result.rows, minutes)
        if table:
            yield f"Ours by theirs, minutes of {name}:\n\n{table}"
    if result.matches:
        yield f"At the peer's own certified error and volume error:\n\n{match_table(result.matches)}"


def _plain(result: Result) -> dict[str, object]:
    """A result as JSON has it."""
    rows = [
        {
            "family": row.family,
            "setting": row.setting,
            "ours": row.ours,
            "own_minutes": row.own_minutes,
            "prusa_minutes": row.prusa_minutes,
            "cpu": row.cpu,
            "strayed": row.strayed,
            "dropped": row.dropped,
            **asdict(row.score),
            "top": row.plan.top.round(5).tolist(),
        }
        for row in result.rows
    ]
    matches = [asdict(one) for one in result.matches]
    return {"part": result.name, "rows": rows, "matches": matches, "failures": result.failures}


if __name__ == "__main__":
    sys.exit(main())
