"""Import all presets in the bundles that PrusaSlicer ships, and compare the results with PrusaSlicer.

    python -m benchmarks.importing [--values N] [--macros N] [--prints N] [--bundle NAME]

1. Import every printer, print and filament preset, or print the reason for a failure. The command fails below 95 %.
2. For N printers with their default print and filament, evenly spread, compare dimensions, limits, temperatures and
   speeds with PrusaSlicer's own values (`--save`).
3. For N printers, compare start and end G-code, with placeholders filled in, with PrusaSlicer's own file. Compare
   pressure advance with the meaning of its commands there to the firmware.
4. For N printers, slice the box and print it on the simulated printer, or print the reason for a failure.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.prusa_presets import (
    BUNDLES,
    FILAMENT,
    Oracle,
    bundles,
    commands_between_marks,
    mark_macros,
    render_macros,
    saved,
)
from printer_slicer import dry_run, job_of, load_mesh, load_profile
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.importing import (
    ImportedProfile,
    ImportRequest,
    RejectedProfile,
    format_profile,
    import_profiles,
)

PART = Path(__file__).parent.parent / "sample_parts" / "box.stl"
FEWEST = 0.95
LINEAR_ADVANCE_1 = 10.0
_ADVANCE = re.compile(r"(?:M900 K|SET_PRESSURE_ADVANCE ADVANCE=)(\d*\.?\d+)")
_SAID = re.compile(r"(\w+?)(-?\d*\.?\d+)")
Triple = dict[str, ImportedProfile]


def main() -> int:
    """Run the selected comparisons; return 1 if a result is not as expected."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, usual in (("values", 30), ("macros", 30), ("prints", 12)):
        parser.add_argument(f"--{name}", type=int, default=usual, metavar="N", help=f"default: {usual}")
    parser.add_argument("--bundle", default="", help="only bundles whose name contains this")
    asked = parser.parse_args()
    paths = [path for path in bundles() if asked.bundle in path.name]
    if not paths:
        print(f"{BUNDLES}: no bundles; PrusaSlicer is not installed")
        return 0
    share = coverage(paths)
    printers = list(find_printers(paths))
    with TemporaryDirectory() as folder:
        off = sum(compare_values(one, Path(folder)) for one in choose_printers(printers, asked.values))
        different = sum(compare_macros(one, Path(folder)) for one in choose_printers(printers, asked.macros))
        printed = [
            prints_as_intended(one, Path(folder))
            for one in choose_printers(printers, asked.prints_as_intended)
        ]
    print(
        f"values: {off} differ; macros: {different} differ; printed as intended: {sum(printed)} of {len(printed)}"
    )
    return 0 if share >= FEWEST and not off and not different else 1


def coverage(paths: list[Path]) -> float:
    """Return the share of presets that import, and print the reason for each of the others."""
    counts: Counter[tuple[str, str]] = Counter()
    for path in paths:
        results = import_profiles(path)
        for one in results:
            counts[one.kind, type(one).__name__] += 1
            if isinstance(one, RejectedProfile):
                print(f"rejected: {path.name}: {one.kind} {one.name!r}: {one.problem}")
    for kind in ("printer", "quality", "material"):
        good, bad = counts[kind, "ImportedProfile"], counts[kind, "RejectedProfile"]
        print(f"{kind:<10}{good} of {good + bad} imported ({good / max(good + bad, 1):.1%})")
    good = sum(count for (_, what), count in counts.items() if what == "ImportedProfile")
    print(
        f"{'all':<10}{good} of {counts.total()} imported ({good / counts.total():.1%}), from {len(paths)} bundles"
    )
    return good / counts.total()


def find_printers(paths: list[Path]) -> Iterator[tuple[Path, str]]:
    """Return bundle and name of every filament printer."""
    for path in paths:
        oracle = Oracle(path)
        for name in oracle.names("printer"):
            if oracle.settings("printer", name).get("printer_technology", "FFF") == "FFF":
                yield path, name


def choose_printers(printers: list[tuple[Path, str]], count: int) -> list[tuple[Path, str]]:
    """Return this many printers, evenly spread: first one of each bundle, then more."""
    firsts = {path: (path, name) for path, name in reversed(printers)}
    rest = [one for one in printers if one not in firsts.values()]
    more = max(count - len(firsts), 0)
    step = max(len(rest) // more, 1) if more else 1
    return [*list(firsts.values())[::-1][:count], *rest[step // 2 :: step][:more]] if count else []


def triple(path: Path, printer: str) -> tuple[Triple, dict[str, str], list[RejectedProfile]]:
    """Return the printer with its default print and filament: our profiles, and all settings of PrusaSlicer."""
    results = import_profiles(path, ImportRequest(printer=printer))
    made = {one.kind: one for one in results if isinstance(one, ImportedProfile)}
    oracle = Oracle(path)
    settings: dict[str, str] = {}
    names = {one.kind: one.name for one in results}
    for kind, theirs in (("quality", "print"), ("material", "filament"), ("printer", "printer")):
        if kind in names:
            settings |= oracle.settings(theirs, names[kind])
            settings[f"{theirs}_settings_id"] = f'"{names[kind]}"' if theirs == "filament" else names[kind]
    return made, settings, [one for one in results if isinstance(one, RejectedProfile)]


def expected_values(theirs: Mapping[str, str]) -> dict[str, float]:
    """Return the main values that follow from the settings saved by PrusaSlicer: our key -> number."""

    def first(key: str) -> float:
        """Return the first number of a setting."""
        return float(theirs[key].split(",")[0].strip('"').removesuffix("%"))

    def speed(key: str, whole: float) -> float:
        """Return a speed; 0 means the greatest, and a percentage refers to `whole`."""
        share = theirs[key].endswith("%")
        return first(key) / 100 * whole if share else first(key) or first("max_print_speed")

    corners = [tuple(map(float, word.split("x"))) for word in theirs["bed_shape"].split(",")]
    xs, ys = zip(*corners, strict=True)
    inner = speed("perimeter_speed", 0)
    sparse = speed("infill_speed", 0)
    solid = speed("solid_infill_speed", sparse)
    layer = first("layer_height")
    found = {
        "printer.bed_z": first("max_print_height"),
        "printer.nozzle_diameter": first("nozzle_diameter"),
        "printer.retract_length": first("retract_length"),
        "printer.retract_speed": first("retract_speed"),
        "printer.acceleration": first("machine_max_acceleration_extruding"),
        "printer.retract_acceleration": first("machine_max_acceleration_retracting"),
        "material.nozzle_temperature": first("temperature"),
        "material.first_layer_nozzle_temperature": first("first_layer_temperature"),
        "material.bed_temperature": first("bed_temperature"),
        "material.first_layer_bed_temperature": first("first_layer_bed_temperature"),
        "material.filament_diameter": first("filament_diameter"),
        "material.flow_ratio": first("extrusion_multiplier"),
        "quality.layer_height": layer,
        "quality.first_layer_height": first("first_layer_height")
        * (layer / 100 if "%" in theirs["first_layer_height"] else 1),
        "quality.perimeters": first("perimeters"),
        "quality.infill_density": first("fill_density") / 100,
        "quality.speeds.perimeter": inner,
        "quality.speeds.external_perimeter": speed("external_perimeter_speed", inner),
        "quality.speeds.internal_infill": sparse,
        "quality.speeds.solid_infill": solid,
        "quality.speeds.top_solid_infill": speed("top_solid_infill_speed", solid),
        "quality.speeds.bridge": speed("bridge_speed", 0),
        "quality.speeds.travel": first("travel_speed"),
    }
    if first("filament_max_volumetric_speed"):
        found["material.max_flow"] = first("filament_max_volumetric_speed")
    for axis in "xyze":
        found[f"printer.max_speed_{axis}"] = first(f"machine_max_feedrate_{axis}")
        found[f"printer.max_acceleration_{axis}"] = first(f"machine_max_acceleration_{axis}")
    if len(corners) == 4:
        left, front = min(xs), min(ys)
        found |= {"printer.bed_x": max(xs) - left, "printer.bed_y": max(ys) - front}
        if left != -max(xs):
            found |= {"printer.bed_left": left, "printer.bed_front": front}
    return found


def differences(made: Triple, theirs: Mapping[str, str]) -> list[str]:
    """Return the main values that differ, as texts."""
    wrong = []
    for key, wanted in expected_values(theirs).items():
        kind, *path = key.split(".")
        if kind not in made:
            continue
        value: Any = made[kind].values
        for part in path:
            value = value.get(part, 0)
        if abs(float(value) - wanted) > 1e-6 * max(1.0, abs(wanted)):
            wrong.append(f"{key}: {value}, PrusaSlicer has {wanted}")
    return wrong


def compare_values(printer: tuple[Path, str], folder: Path) -> int:
    """Return how many main values of a printer and its companions differ."""
    made, settings, rejected = triple(*printer)
    wrong = differences(made, saved(settings, folder))
    print(f"values   {printer[1]}: {'; '.join(wrong) or f'equal ({len(made)} presets)'}")
    for one in rejected:
        print(f"         {one.kind} {one.name!r} rejected: {one.problem}")
    return len(wrong)


def load_imported(made: Triple, folder: Path, **changes: object) -> Any:
    """Return the imported profiles as the program reads them."""
    paths = {}
    for kind, one in made.items():
        paths[kind] = folder / f"{kind}.toml"
        paths[kind].write_text(format_profile(one), encoding="utf-8")
    printer, material, quality = (str(paths[kind]) for kind in ("printer", "material", "quality"))
    return load_profile(printer, material, quality, changes)


def our_macros(made: Triple, folder: Path, heights: Mapping[str, str]) -> dict[str, list[str]]:
    """Return start and end G-code from our file."""
    changes: dict[str, object] = dict(heights)
    for key in ("start_gcode", "end_gcode"):
        changes[f"printer.{key}"] = f";==={key}\n{made['printer'].values.get(key, '')}\n;==="
    job = job_of(load_mesh(PART), load_imported(made, folder, **changes))
    return dict(commands_between_marks(job.text.decode()))


def is_same_command(ours: str, theirs: str) -> bool:
    """Return whether two commands are equal apart from the format of numbers."""
    numbers = [[float(word[1]) for word in _SAID.findall(line)] for line in (ours, theirs)]
    words = [_SAID.sub(r"\1", line) for line in (ours, theirs)]
    close = all(abs(a - b) <= 1e-3 + 1e-5 * abs(b) for a, b in zip(*numbers, strict=False))
    return words[0].split() == words[1].split() and len(numbers[0]) == len(numbers[1]) and close


def compare_macros(printer: tuple[Path, str], folder: Path) -> int:
    """Return how many lines of start and end G-code differ."""
    made, settings, _ = triple(*printer)
    if len(made) < 3:
        print(f"macros   {printer[1]}: not all of its presets import")
        return 0
    # The box is a multiple of this height, so both programs end the last layer at the top of the part.
    low, high = (made["printer"].values[key] for key in ("min_layer", "max_layer"))
    height = next((one for one in (0.1, 0.125, 0.2, 0.25, 0.5) if low <= one <= high), low)
    same_heights = {"layer_height": f"{height}", "first_layer_height": f"{height}"}
    theirs = render_macros(mark_macros(settings | same_heights), PART, folder)
    if isinstance(theirs, str):
        print(f"macros   {printer[1]}: PrusaSlicer does not slice with this printer: {theirs}")
        return 0
    try:
        ours = our_macros(made, folder, {f"quality.{key}": value for key, value in same_heights.items()})
    except PrinterSlicerError as error:
        print(f"macros   {printer[1]}: {str(error).splitlines()[0]}")
        return 0
    filament = theirs.pop(FILAMENT, None)
    advance = [] if filament is None else compare_advance(made["material"], filament)
    wrong = [line for key in theirs for line in find_missing_commands(ours.get(key, []), theirs[key])]
    total = sum(map(len, theirs.values()))
    print(f"macros   {printer[1]}: {total} commands; {'; '.join(wrong) or 'all the same'}")
    return len(wrong) + len(advance)


def compare_advance(material: ImportedProfile, theirs: list[str]) -> list[str]:
    """Return a text if pressure advance differs from the value that the firmware takes from these commands.

    The first M900 decides: a K of 10 or more belongs to Linear Advance 1.0 and is not a time. Then commands of the
    other scale are ignored. Source: Prusa's knowledge base, "Linear Advance".
    """
    said = [float(found[1]) for line in theirs if (found := _ADVANCE.match(line))]
    wanted = [value for value in said if (value < LINEAR_ADVANCE_1) == (said[0] < LINEAR_ADVANCE_1)][-1:]
    expected_one = wanted[0] if wanted and wanted[0] < LINEAR_ADVANCE_1 else 0.0
    found_one = material.values.get("pressure_advance", 0.0)
    if abs(found_one - expected_one) < 1e-9:
        return []
    wrong = f"pressure_advance {found_one:g}, but PrusaSlicer's file has {said}"
    print(f"macros   {material.name}: {wrong}")
    return [wrong]


def find_missing_commands(ours: list[str], theirs: list[str]) -> Iterator[str]:
    """Return the commands of PrusaSlicer's macro that ours lacks, in order."""
    place = 0
    for line in theirs:
        if line.startswith(
            "M73 "
        ):  # progress commands that PrusaSlicer inserts between the lines of the macro
            continue
        found = next((i for i in range(place, len(ours)) if is_same_command(ours[i], line)), None)
        if found is None:
            yield f"{line!r}, but ours is {ours[place] if place < len(ours) else 'nothing'!r}"
        else:
            place = found + 1


def prints_as_intended(printer: tuple[Path, str], folder: Path) -> bool:
    """Return whether the box is printed as intended on the simulated printer."""
    made, _, rejected = triple(*printer)
    why = rejected[0].problem if rejected else ""
    if len(made) == 3:
        try:
            profile = load_imported(made, folder)
            verdict = dry_run(job_of(load_mesh(PART), profile), profile)
            why = verdict.problems[0] if verdict.problems else ""
        except PrinterSlicerError as error:
            why = str(error).splitlines()[0]
    print(f"prints   {printer[1]}: {why or 'as intended'}")
    return not why


if __name__ == "__main__":
    sys.exit(main())
