"""Compare our `slice` with PrusaSlicer and CuraEngine in whole processes: same part, same settings.

    python -m benchmarks.compare [--rounds N] [--models DIR] [--quality NAME] [--printer NAME] [--set KEY=VALUE]
                                 [--json FILE] [part ...]

Parts are those of the models folder, the sample parts, and parts that other benchmarks make.

One round runs each program once, one after the other, so that other load on the machine affects all of them. Each ratio
is taken within a round. The output shows the median over the rounds with its extremes. The first run of each program is
a warm-up.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median

from benchmarks.cura_settings import find_definitions
from benchmarks.processes import SAMPLES, WORK, Cost, RunError, machine_note, ours, run, spread

PEER = "prusa-slicer"
MODELS = ("benchy", "crazyradio", "ringing_tower")
"""Parts from the models folder that are used if no part is named."""

MADE_BY: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(
        ("angle_bracket", "electronics_box", "belt_pulley", "knurled_knob", "threaded_adapter"),
        ("-m", "benchmarks.functional_parts"),
    ),
    "plate": ("-m", "benchmarks.plate"),
    "torus_5m": ("-m", "benchmarks.big_mesh", "--facets", "5000000", "--output", str(WORK / "torus_5m.stl")),
}
"""Arguments for Python, by name of the part that it makes."""

SETTINGS: Mapping[str, tuple[str, ...]] = {"plate": ("printer.bed_x=400", "printer.bed_y=400")}
"""Settings that a part needs."""

_EQUAL = ("--resolution", "0.0125")
VARIANTS: Mapping[str, tuple[str, ...]] = {
    "default": (),
    "equal resolution": _EQUAL,
    "lean": (
        *("--perimeter-generator", "classic", "--seam-position", "rear"),
        *("--no-extra-perimeters", *_EQUAL),
    ),
}
"""Options in addition to the common settings of PrusaSlicer; its other settings are at their defaults.

With equal resolution it simplifies outlines as we do, and lean it also works out as little as we do.
"""
CURA = "CuraEngine"

SAME: Mapping[str, str] = {
    "max-print-height": "printer.bed_z",
    "nozzle-diameter": "printer.nozzle_diameter",
    "retract-length": "printer.retract_length",
    "retract-speed": "printer.retract_speed",
    "deretract-speed": "printer.deretract_speed",
    "retract-before-travel": "printer.retract_before_travel",
    "filament-diameter": "material.filament_diameter",
    "temperature": "material.nozzle_temperature",
    "first-layer-temperature": "material.first_layer_nozzle_temperature",
    "bed-temperature": "material.bed_temperature",
    "first-layer-bed-temperature": "material.first_layer_bed_temperature",
    "slowdown-below-layer-time": "material.min_layer_time",
    "min-print-speed": "material.min_speed",
    "layer-height": "quality.layer_height",
    "perimeters": "quality.perimeters",
    "fill-angle": "quality.infill_angle_deg",
    "skirts": "quality.skirt_loops",
    "skirt-distance": "quality.skirt_distance",
    "perimeter-speed": "quality.speeds.perimeter",
    "external-perimeter-speed": "quality.speeds.external_perimeter",
    "infill-speed": "quality.speeds.internal_infill",
    "solid-infill-speed": "quality.speeds.solid_infill",
    "top-solid-infill-speed": "quality.speeds.top_solid_infill",
    "bridge-speed": "quality.speeds.bridge",
    "first-layer-speed": "quality.speeds.first_layer",
    "travel-speed": "quality.speeds.travel",
}
"""Settings that PrusaSlicer gets with our values: its name, our name."""

CPU_TARGET, PEAK_TARGET = 0.25, 1.5
"""On benchy, against PrusaSlicer with its other settings at their defaults."""

_USED = """
import json, sys
from pathlib import Path
from printer_slicer.importing import format_profile, import_profiles
from printer_slicer.profile import list_settings, load_profile
from tempfile import TemporaryDirectory
with TemporaryDirectory() as folder:
    paths = {}
    for one in import_profiles(Path(sys.argv[1])):
        paths[one.kind] = Path(folder, one.kind + ".toml")
        paths[one.kind].write_text(format_profile(one), encoding="utf-8")
    used = load_profile(**{kind: str(path) for kind, path in paths.items()}).resolved
print(json.dumps({key: str(value) for key, value in list_settings(used)}))
"""
"""Code that prints the settings of a G-code file as they are used, with the speeds of the printer."""

_CURA_OPTIONS = """
import json, sys
from pathlib import Path
from benchmarks.cura_settings import cura_settings, find_definitions
from printer_slicer.profile import complete_profile
from printer_slicer.profile.gcode_settings import read_settings_from_gcode
definitions = find_definitions()
profile = complete_profile(read_settings_from_gcode(Path(sys.argv[1])), {}, {}, ())
height = float(sys.argv[2])
first = profile.quality.first_layer_height or height
wanted = cura_settings(profile) | {"layer_height": height, "layer_height_0": first, "center_object": True}
words = [word for key, text in definitions.settings(wanted).items() for word in ("-s", f"{key}={text}")]
print(json.dumps(["-j", str(definitions.machine), *words, "-e0", *words]))
"""
"""Code that prints the options of CuraEngine for the settings in one of our G-code files."""

_EXPORT = "import sys, trimesh; trimesh.load(sys.argv[1], force='mesh').export(sys.argv[2], file_type='stl')"


@dataclass(frozen=True, slots=True)
class Facts:
    """What a G-code file extrudes, from its first layer comment on.

    Attributes:
        moves: G1 lines with E and X or Y.
        filament: mm fed by them.
        layers: layer comments.
        roles: mm of filament by the role that the file's type comments name.
    """

    moves: int
    filament: float
    layers: int
    roles: dict[str, float]


@dataclass(slots=True)
class Result:
    """Costs of every program in every round for one part, and facts about the files that they wrote."""

    part: str
    costs: dict[str, list[Cost]] = field(default_factory=dict)
    facts: dict[str, Facts] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    def ratios(self, peer: str, what: Callable[[Cost], float]) -> list[float]:
        """Return our value divided by the peer's, round by round."""
        return [what(a) / what(b) for a, b in zip(self.costs["ours"], self.costs[peer], strict=True)]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; return 1 if a part could not be measured."""
    options = _options(argv)
    WORK.mkdir(exist_ok=True)
    peers = [*VARIANTS] if shutil.which(PEER) else []
    peers += [CURA] if shutil.which(CURA) and find_definitions() else []
    print(", ".join([machine_note(), *_find_peer_versions()]), flush=True)
    if not peers:
        print(f"{PEER} and {CURA} are not installed: the table shows only our own times")
    results = []
    for model in _find_parts(options.models, options.parts):
        results.append(_measure(model, peers, options.rounds, _our_arguments(options)))
        print(f"measured {results[-1].part}", file=sys.stderr)
    for name in peers or [""]:
        print("\n" + _table(results, name))
    for result in results:
        for program, reason in result.failures.items():
            print(f"{result.part}: {program} failed: {reason}")
    _print_target(results)
    if options.json:
        note = {"machine": machine_note(), "rounds": options.rounds, "quality": options.quality}
        options.json.write_text(json.dumps({**note, "parts": [asdict(r) for r in results]}, indent=1) + "\n")
    return int(any(not result.costs for result in results))


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Compare our slice with PrusaSlicer in whole processes.")
    parser.add_argument("parts", nargs="*", help="part names without extension; default: all")
    parser.add_argument("--rounds", type=int, default=5, help="measured runs of each program (default 5)")
    parser.add_argument(
        "--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)"
    )
    parser.add_argument("--quality", default="standard", help="our quality profile (default standard)")
    parser.add_argument("--printer", default="marlin_220", help="our printer profile (default marlin_220)")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], help="change one of our settings"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all measurements to this file")
    options = parser.parse_args(argv)
    if options.rounds < 1:
        parser.error("--rounds must be at least 1")
    if options.models is None and os.environ.get("PRINTER_SLICER_MODELS"):
        options.models = Path(os.environ["PRINTER_SLICER_MODELS"])
    if options.models is not None and not options.models.is_dir():
        parser.error(f"--models {options.models}: no such folder")
    return options


# Choosing parts


def _find_parts(models: Path | None, wanted: Sequence[str]) -> list[Path]:
    """Return the parts to slice: large ones from the models folder, then the sample parts."""
    known: dict[str, Path] = {name: WORK / f"{name}.stl" for name in MADE_BY}
    for folder in (models, SAMPLES):
        for path in sorted(folder.iterdir()) if folder else []:
            if path.suffix.lower() in (".stl", ".3mf", ".obj"):
                known.setdefault(path.stem, path)
    samples = [name for name, path in known.items() if path.parent == SAMPLES]
    names = list(wanted) or [*(name for name in MODELS if name in known), *samples]
    unknown = [name for name in names if name not in known]
    if unknown:
        sys.exit(f"no part {', '.join(unknown)}; known parts: {', '.join(known)}")
    for name in names:
        if name in MADE_BY and not known[name].exists():
            run([sys.executable, *MADE_BY[name]], folder=SAMPLES.parent)
    return [_as_stl(known[name]) for name in names]


def _as_stl(path: Path) -> Path:
    """Return the part as STL, converted once, so that both programs read the same triangles."""
    if path.suffix.lower() == ".stl":
        return path
    target = WORK / f"{path.stem}.stl"
    if not target.exists() or target.stat().st_mtime < path.stat().st_mtime:
        run([sys.executable, "-c", _EXPORT, str(path), str(target)])
    return target


# Measuring


def _our_arguments(options: argparse.Namespace) -> list[str]:
    """Return the arguments for our own program."""
    changes = [word for change in options.set for word in ("--set", change)]
    return ["--quality", options.quality, "--printer", options.printer, *changes]


def _measure(model: Path, peers: Sequence[str], rounds: int, settings: Sequence[str]) -> Result:
    """Warm up every program, then run them in turn."""
    result = Result(model.stem)
    outputs = {name: WORK / f"{model.stem}_{name.replace(' ', '_')}.gcode" for name in ("ours", *peers)}
    needed = [word for change in SETTINGS.get(model.stem, ()) for word in ("--set", change)]
    commands = {"ours": ours("slice", str(model), "-o", str(outputs["ours"]), *settings, *needed)}
    if not _warm_up(result, "ours", commands, outputs):
        return result
    used = _read_settings(outputs["ours"])
    common = _matching_options(used)
    for name in peers:
        if name == CURA:
            words = _cura_options(outputs["ours"], used["quality.layer_height"])
            commands[name] = [CURA, "slice", *words, "-l", str(model), "-o", str(outputs[name])]
        else:
            target = str(outputs[name])
            commands[name] = [PEER, "--export-gcode", str(model), "-o", target, *common, *VARIANTS[name]]
        _warm_up(result, name, commands, outputs)
    try:
        costs = [{name: run(commands[name]) for name in result.facts} for _ in range(rounds)]
    except RunError as error:  # the warm-up succeeded, so no run of this part can be trusted
        result.failures["a measured run"] = str(error)
        return result
    result.costs = {name: [cost[name] for cost in costs] for name in result.facts}
    return result


def _warm_up(
    result: Result, name: str, commands: Mapping[str, list[str]], outputs: Mapping[str, Path]
) -> bool:
    """Run a program once and read its output; return whether it succeeded."""
    outputs[name].unlink(missing_ok=True)
    try:
        run(commands[name])
        result.facts[name] = _count_extrusions(outputs[name])
    except (RunError, FileNotFoundError) as error:
        result.failures[name] = str(error)
    return name in result.facts


def _read_settings(gcode: Path) -> dict[str, str]:
    """Return the settings at the end of our G-code, with the values in use; another process reads them."""
    found = re.findall(
        r"^; ([a-z_.]+) = (.*)$", gcode.read_text("ascii").partition("\n; settings\n")[2], re.MULTILINE
    )
    said = subprocess.run(
        [sys.executable, "-c", _USED, str(gcode)], capture_output=True, text=True, check=True
    ).stdout
    return dict(found) | json.loads(said)


def _cura_options(gcode: Path, layer_height: str) -> list[str]:
    """Return the settings of one of our G-code files as arguments for CuraEngine; another process converts them."""
    said = subprocess.run(
        [sys.executable, "-c", _CURA_OPTIONS, str(gcode), layer_height],
        capture_output=True,
        text=True,
        check=True,
        cwd=SAMPLES.parent,
    ).stdout
    words: list[str] = json.loads(said)
    return words


def _matching_options(settings: Mapping[str, str]) -> list[str]:
    """Return our settings as arguments for PrusaSlicer, as far as both programs have them."""

    def value(key: str) -> float:
        return float(settings[key])

    height = value("quality.layer_height")
    width = value("quality.extrusion_width") or 1.125 * value("printer.nozzle_diameter")
    bed_x, bed_y = value("printer.bed_x"), value("printer.bed_y")
    same = {theirs: f"{value(key):g}" for theirs, key in SAME.items()} | {
        "bed-shape": f"0x0,{bed_x:g}x0,{bed_x:g}x{bed_y:g},0x{bed_y:g}",
        "center": f"{bed_x / 2:g},{bed_y / 2:g}",
        "first-layer-height": f"{value('quality.first_layer_height') or height:g}",
        "extrusion-width": f"{width:g}",
        "first-layer-extrusion-width": f"{width:g}",
        "bottom-solid-layers": f"{value('quality.bottom_thickness') / height:.0f}",
        "top-solid-layers": f"{value('quality.top_thickness') / height:.0f}",
        "fill-pattern": settings["quality.infill"],
        "solid-infill-below-area": f"{value('quality.solid_infill_below_area'):g}",
        "fill-density": f"{value('quality.infill_density') * 100:g}%",
    }
    return [word for key, text in same.items() for word in (f"--{key}", text)]


def _count_extrusions(gcode: Path) -> Facts:
    """Count the extrusions of a G-code file; E may be absolute or relative."""
    words = re.compile(r"([XYE])(-?[\d.]+)")
    moves, layers, last, relative, role = 0, 0, 0.0, False, ""
    roles: dict[str, float] = {}
    for line in gcode.read_text("utf-8", "replace").splitlines():
        if line.startswith((";LAYER_CHANGE", ";LAYER:")):
            layers += 1
        elif line.startswith(";TYPE:"):
            role = line.removeprefix(";TYPE:")
        elif line.startswith(("M82", "M83")):
            relative = line.startswith("M83")
        elif line.startswith(("G1 ", "G92 ")):
            values = {letter: float(number) for letter, number in words.findall(line.partition(";")[0])}
            if "E" not in values:
                continue
            fed = values["E"] if relative else values["E"] - last
            last = values["E"]
            if layers and line.startswith("G1 ") and len(values) > 1:
                moves += 1
                roles[role] = roles.get(role, 0.0) + fed
    return Facts(moves, sum(roles.values()), layers, roles)


# Printing results


def _table(results: Sequence[Result], peer: str) -> str:
    """Return one row per part: ours against one variant of PrusaSlicer, or ours alone."""
    if not peer:
        lines = ["| part | CPU s | wall s | peak MiB | moves | filament m | layers |", "|---|" + "---:|" * 6]
        return "\n".join(lines + [_row_alone(result) for result in results if result.costs])
    lines = [
        f"ours / {peer if peer == CURA else f'{PEER}, {peer}'}; median [min..max] of pairwise ratios",
        "",
        "| part | CPU s | CPU ratio | wall ratio | peak memory ratio | moves | filament m | layers |",
        "|---|---:|---:|---:|---:|---:|---:|---:|",
    ]
    return "\n".join(lines + [_row(result, peer) for result in results if peer in result.costs])


def _row(result: Result, peer: str) -> str:
    one, two = result.facts["ours"], result.facts[peer]
    cpu = [median(cost.cpu for cost in result.costs[name]) for name in ("ours", peer)]
    cells = [
        result.part,
        f"{cpu[0]:.2f} / {cpu[1]:.2f}",
        spread(result.ratios(peer, lambda cost: cost.cpu), ".2f"),
        spread(result.ratios(peer, lambda cost: cost.wall), ".2f"),
        spread(result.ratios(peer, lambda cost: cost.peak), ".2f"),
        f"{one.moves} / {two.moves}",
        f"{one.filament / 1000:.3f} / {two.filament / 1000:.3f}",
        f"{one.layers} / {two.layers}",
    ]
    return f"| {' | '.join(cells)} |"


def _row_alone(result: Result) -> str:
    costs, facts = result.costs["ours"], result.facts["ours"]
    cells = [
        result.part,
        spread([cost.cpu for cost in costs], ".2f"),
        spread([cost.wall for cost in costs], ".2f"),
        spread([cost.peak for cost in costs], ".0f"),
        str(facts.moves),
        f"{facts.filament / 1000:.3f}",
        str(facts.layers),
    ]
    return f"| {' | '.join(cells)} |"


def _print_target(results: Sequence[Result]) -> None:
    """Print whether the target for benchy is met, if benchy was measured."""
    for result in results:
        if result.part == "benchy" and {"ours", "default"} <= result.costs.keys():
            cpu = median(result.ratios("default", lambda cost: cost.cpu))
            peak = median(result.ratios("default", lambda cost: cost.peak))
            met = "met" if cpu <= CPU_TARGET and peak <= PEAK_TARGET else "MISSED"
            print(
                f"\ntarget on benchy, at most {CPU_TARGET:g} of the CPU and {PEAK_TARGET:g} of the peak memory:"
                f" {cpu:.3f} and {peak:.2f}: {met}"
            )


def _find_peer_versions() -> Iterator[str]:
    """Yield the installed peers with the versions that they report."""
    for program, option, pattern in (
        (PEER, "--help", r"PrusaSlicer-[\w.]+"),
        (CURA, "help", r"version [\d.]+"),
    ):
        if shutil.which(program):
            said = subprocess.run([program, option], capture_output=True, text=True, check=False)
            found = re.search(pattern, said.stdout + said.stderr)
            yield f"{program} {found[0].removeprefix('PrusaSlicer-') if found else '(unknown version)'}"


if __name__ == "__main__":
    sys.exit(main())
