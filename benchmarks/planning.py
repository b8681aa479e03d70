"""Compare the layer plans of every planner and of other slicers: deviation of the surface against minutes.

    python -m benchmarks.planning [--models DIR] [--printer NAME] [--heights THIN THICK] [part ...]

The same functions score all plans of a part: the time of our toolpaths, the distance of points on the part from the
printed stack, the certified error and volume error, flats and part height. For peers, the output also has the time of
their own G-code on our machine model. For our plans, it also has the time of PrusaSlicer's toolpaths. Results go to
`benchmarks/made/`: the figures as JSON, a picture for each part, and the peers' G-code. The G-code is used again while
part, profile and peer are the same.
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
from benchmarks.match import Match, find_match
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
    """Results for one part.

    Attributes:
        name: name of the part.
        rows: all plans.
        matches: our plans at the errors of the peers' plans.
        failures: a line for every failure.
    """

    name: str
    rows: list[Row] = field(default_factory=list)
    matches: list[Match] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; return 1 if a part could not be measured."""
    options = _options(argv)
    models = _find_models(options.models, options.parts)
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
        _print_result(results[-1])
    print("\nOurs divided by theirs, all parts\n")
    print(part_table([(result.name, result.rows, result.matches) for result in results]))
    print("\n" + judgement([(result.rows, result.matches) for result in results]))
    target = options.json or WORK / "planning.json"
    target.write_text(
        json.dumps({"note": note, "parts": [_to_json(result) for result in results]}, indent=1) + "\n"
    )
    print(f"figures: {target}")
    return int(any(not result.rows for result in results))


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.planning",
        description="Compare the layer plans of every planner and of other slicers.",
    )
    add = parser.add_argument
    add("parts", nargs="*", help="files, or names without extension; default: all sample parts and models")
    add("--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)")
    add("--printer", help="printer profile; all minutes are for its machine")
    add("--material", help="material profile")
    add(
        "--heights",
        type=float,
        nargs=2,
        default=(0.1, 0.3),
        metavar=("THIN", "THICK"),
        help="thinnest and thickest layer, mm (default 0.1 0.3)",
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


def _find_models(models: Path | None, wanted: Sequence[str]) -> list[Path]:
    """Return the files to measure."""
    known: dict[str, Path] = {}
    for folder in (models, SAMPLES):
        for path in sorted(folder.iterdir()) if folder else []:
            if path.suffix.lower().removeprefix(".") in FORMATS:
                known.setdefault(path.stem, path)
    found = [known[name] if name in known else Path(name) for name in wanted or known]
    missing = [str(path) for path in found if not path.is_file()]
    if missing:
        sys.exit(f"no part {', '.join(missing)}; known parts: {', '.join(known)}")
    return found


# Measuring


def _measure(
    path: Path,
    profile: Profile,
    folder: Path,
    peers: tuple[PrusaSlicer | None, CuraEngine | None],
    options: argparse.Namespace,
) -> Result:
    """Measure all plans of one part; a plan that fails is reported and left out."""
    result = Result(path.stem)
    try:
        part = Part(place(_enlarge(result, load_mesh(path)), profile.printer), profile, folder)
    except PrinterSlicerError as error:
        _report_failure(result, f"{path.stem}: {error}")
        return result
    judge, prusa = Judge(part, options.points), peers[0]
    for family, run in peer_attempts(part, *peers, quick=options.quick):
        _try_row(result, family, lambda family=family, run=run: peer_row(judge, family, run()))  # type: ignore[misc]
    fed = None if options.no_feed else prusa
    for attempt in attempts(part, quick=options.quick):
        _try_row(result, attempt.family, lambda attempt=attempt: our_row(judge, attempt, fed))  # type: ignore[misc]
    for row in [] if options.no_match else _distinct_rows(result.rows):
        print(f"{result.name}: matching {row.family} {row.setting}", file=sys.stderr, flush=True)
        result.matches.append(find_match(judge, row))
    return result


def _enlarge(result: Result, mesh: Mesh) -> Mesh:
    """Return the mesh, enlarged if it is too small to print."""
    sized, size_note = printable(mesh)
    if size_note:
        _report_failure(result, size_note)
    return sized


def _distinct_rows(rows: Sequence[Row]) -> list[Row]:
    """Return one row for each plan of the peers: uniform layers are the same for all peers."""
    return list({row.plan.top.tobytes(): row for row in reversed(rows) if not row.ours}.values())[::-1]


def _try_row(result: Result, family: str, make: Callable[[], Row]) -> None:
    """Add a row if it can be made."""
    try:
        row = make()
    except (PrinterSlicerError, RunError) as error:
        _report_failure(result, f"{result.name}: {family}: {error}")
        return
    result.rows.append(row)
    score = row.score
    print(
        f"{result.name}: {family} {row.setting}: {score.layers} layers, {score.minutes:.1f} min, "
        f"{1e3 * score.mean:.2f} µm",
        file=sys.stderr,
        flush=True,
    )


def _report_failure(result: Result, line: str) -> None:
    """Report a line, and keep it as a failure of the part."""
    result.failures.append(line)
    print(line, file=sys.stderr, flush=True)


# Printing results


def _print_result(result: Result) -> None:
    """Print the tables of one part, and draw its picture."""
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
    yield f"Distances in µm; sampling gives the means a standard error of at most {1e3 * error:.2f}."
    strayed = [row.strayed for row in result.rows if row.strayed is not None]
    if strayed:
        dropped = max(row.dropped or 0 for row in result.rows)
        yield (
            f"PrusaSlicer printed the layers of {len(strayed)} of our plans within {1e3 * max(strayed):.2f} µm of "
            f"their heights and left at most {dropped} layers of a plan empty."
        )
    for name, minutes in BASES:
        table = ratio_table(result.rows, minutes)
        if table:
            yield f"Ours divided by theirs, minutes of {name}:\n\n{table}"
    if result.matches:
        yield f"At the peer's own certified error and volume error:\n\n{match_table(result.matches)}"


def _to_json(result: Result) -> dict[str, object]:
    """Return a result in the form of JSON."""
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
