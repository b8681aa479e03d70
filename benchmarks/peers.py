"""Other slicers: how to run them with our settings, and which layers they print.

Layers are read from their G-code: every z at which plastic is laid while moving in x or y is the top of one, down to
the one below. Minutes are those of the file's moves on our machine model, from the first one to the last.

What was looked at with PrusaSlicer 2.5.0 and CuraEngine 4.13.0:

- PrusaSlicer prints any stack of layers that a profile of steps in a 3MF file describes: on four parts with random
  heights between 0.1 and 0.3 mm every z was within 0.0005 mm, the rounding of its G-code, and no layer was left out. It
  lays nothing in a tip too thin for a bead, and adds layers over a stack that stops short by more than half of its
  last one. Its own adaptive profile it samples anew: 314 of 315 layers of benchy remained, some of them 0.10 mm from
  where the rule had ended one, and the top came out 0.017 mm low.
- Where a layer is cut was measured on a cone with one perimeter, as the share of the layer's height at which the part
  is as wide as what is printed: 0.55 to 0.57 with PrusaSlicer, 0.51 with CuraEngine's uniform and 1.02 with its
  adaptive layers. So they are cut in the middle, in the middle and at the top.
- CuraEngine, unlike Cura, does not work out settings that follow from others (see `cura_settings`), and it knows
  shells only as a number of layers of the nominal height.
"""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np

from benchmarks.cura_settings import Definitions, cura_settings, find_definitions
from benchmarks.processes import RunError, run
from benchmarks.prusa_rule import HeightLimits, adaptive_profile, model_xml, stack_profile, write_3mf
from benchmarks.prusa_settings import prusa_settings
from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.commands import split_gcode
from printer_slicer.gcode import read_moves
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile

__all__ = ["CuraEngine", "Part", "Printed", "PrusaSlicer", "find_peers"]


@dataclass(eq=False)
class Part:
    """A part that several slicers print, all with the settings of one profile.

    Attributes:
        mesh: standing on z = 0 in the middle of the bed.
        profile: heights that a planner may choose are `thinnest` to `thickest`.
        folder: for what the slicers read and write.
    """

    mesh: Mesh
    profile: Profile
    folder: Path

    @property
    def heights(self) -> HeightLimits:
        """What a peer may choose from."""
        quality = self.profile.quality
        first = quality.first_layer_height or quality.layer_height
        return HeightLimits(first, self.profile.thinnest, quality.layer_height, self.profile.thickest)

    @cached_property
    def model(self) -> str:
        """The part as the model of a 3MF file."""
        return model_xml(self.mesh)

    @cached_property
    def stl(self) -> Path:
        """The part as STL file, standing on z = 0 over the origin: CuraEngine puts that on the middle of the bed."""
        path = self.folder / f"{self.mesh.name}.centred.stl"
        x, y = np.mean(self.profile.printer.corners, axis=0).tolist()
        export_stl(self.mesh.moved((-x, -y, 0.0)), path)
        return path

    @cached_property
    def digest(self) -> str:
        """The same for the same part with the same profile."""
        return sha256(self.mesh.triangles.tobytes() + repr(self.profile).encode()).hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class Printed:
    """What a peer made of a part.

    Attributes:
        peer: name and version.
        setting: how it was asked to choose its layers.
        plan: the z at which it lays plastic, and where it cut the part for each.
        gcode: the file.
        seconds: modelled time of its moves on our machine, homing and heating not counted.
        filament: mm that its moves feed.
    """

    peer: str
    setting: str
    plan: LayerPlan
    gcode: Path
    seconds: float
    filament: float


class PrusaSlicer:
    """PrusaSlicer's command line; it cuts every layer in its middle."""

    program = "prusa-slicer"

    def __init__(self, walls: str = "classic", **more: str) -> None:
        """Take how it makes perimeters, `classic`, or `arachne`, which it does by default; and more of its settings."""
        said = subprocess.run([self.program, "--help"], capture_output=True, text=True, check=False).stdout
        found = re.search(r"PrusaSlicer-([\d.]+)", said)
        self.name = f"PrusaSlicer {found[1] if found else '(unknown version)'}"
        self.name += "" if walls == "classic" else f" {walls}"
        self.name += "".join(f" {key.replace('_', ' ')} {value}".rstrip() for key, value in more.items())
        self._walls = walls
        self._more = {key.replace("_", "-"): value for key, value in more.items()}

    def uniform(self, part: Part, height: float) -> Printed:
        """Layers of one height, mm, after the first."""
        return self._sliced(part, f"uniform {height:g}", height)

    def adaptive(self, part: Part, quality: float) -> Printed:
        """Its own adaptive layers, between the part's thinnest and thickest; quality 0 is finest, 1 coarsest."""
        profile = adaptive_profile(part.mesh, part.heights, quality)
        return self._sliced(part, f"adaptive {quality:g}", part.heights.nominal, profile)

    def stack(self, part: Part, plan: LayerPlan) -> Printed:
        """Any stack of layers; what it changes shows in the plan of the result."""
        profile = stack_profile(plan.top, part.mesh.height)
        return self._sliced(part, "stack", part.heights.nominal, profile, first=float(plan.top[0]))

    def _sliced(
        self,
        part: Part,
        setting: str,
        height: float,
        profile: Float | None = None,
        *,
        first: float | None = None,
    ) -> Printed:
        settings = (
            prusa_settings(part.profile, self._walls)
            | self._more
            | {
                "layer-height": f"{height:g}",
                "first-layer-height": f"{part.heights.first if first is None else first:.6g}",
                "min-layer-height": f"{part.heights.thinnest:g}",
                "max-layer-height": f"{part.heights.thickest:g}",
            }
        )
        words = [
            word for key, text in settings.items() for word in ([f"--{key}", text] if text else [f"--{key}"])
        ]
        digest = _digest(part, self.name, words, b"" if profile is None else profile.tobytes())
        gcode = part.folder / f"{part.mesh.name}.prusa.{_file_name(setting)}.{digest}.gcode"
        if not gcode.exists():
            source, unfinished = gcode.with_suffix(".3mf"), gcode.with_suffix(".part.gcode")
            write_3mf(source, part.model, profile)
            try:
                run([self.program, "--export-gcode", str(source), "--output", str(unfinished), *words])
            finally:
                source.unlink()
            unfinished.rename(gcode)
        return _read(part, self.name, setting, gcode, cut_ratio=0.5)


class CuraEngine:
    """CuraEngine's command line. Uniform layers are cut in their middle, adaptive ones at their top.

    Its beads are rectangles: one of our width lies as far from the next as it is wide, and holds more than ours,
    whose sides are round. With `same_beads` its lines are as wide as ours lie apart, and hold as much per mm.
    """

    program = "CuraEngine"

    def __init__(self, definitions: Definitions, *, same_beads: bool = False) -> None:
        said = subprocess.run([self.program, "help"], capture_output=True, text=True, check=False)
        found = re.search(r"version ([\d.]+)", said.stdout + said.stderr)
        self.name = f"CuraEngine {found[1] if found else '(unknown version)'}"
        self.name += " same beads" if same_beads else ""
        self.definitions = definitions
        self._same_beads = same_beads

    def uniform(self, part: Part, height: float, **more: object) -> Printed:
        """Layers of one height, mm, after the first; `more` of its settings."""
        settings: dict[str, object] = {"layer_height": height, **more}
        if self._same_beads:
            settings["line_width"] = round(float(bead.spacing(part.profile.extrusion_width, height)), 4)
        return self._sliced(part, f"uniform {height:g}", settings, cut_ratio=0.5)

    def adaptive(self, part: Part, threshold: float, step: float = 0.01) -> Printed:
        """Its adaptive layers: `threshold` is how far stairs may reach out, `step` how fast heights may change, mm.

        It knows one variation for both directions, so its heights are nominal ± the wider side of the part's range.
        """
        heights = part.heights
        variation = max(heights.nominal - heights.thinnest, heights.thickest - heights.nominal)
        settings = {
            "layer_height": heights.nominal,
            "adaptive_layer_height_enabled": True,
            "adaptive_layer_height_variation": round(variation, 6),
            "adaptive_layer_height_variation_step": step,
            "adaptive_layer_height_threshold": threshold,
        }
        return self._sliced(part, f"adaptive {threshold:g}/{step:g}", settings, cut_ratio=1.0)

    def _sliced(
        self, part: Part, setting: str, changes: Mapping[str, object], *, cut_ratio: float
    ) -> Printed:
        wanted = cura_settings(part.profile) | {"layer_height_0": part.heights.first, **changes}
        settings = self.definitions.settings(wanted)
        words = [word for key, text in settings.items() for word in ("-s", f"{key}={text}")]
        digest = _digest(part, self.name, words)
        gcode = part.folder / f"{part.mesh.name}.cura.{_file_name(setting)}.{digest}.gcode"
        if not gcode.exists():
            unfinished = gcode.with_suffix(".part.gcode")
            machine = ["-j", str(self.definitions.machine), *words, "-e0", *words]
            run([self.program, "slice", *machine, "-l", str(part.stl), "-o", str(unfinished)])
            unfinished.rename(gcode)
        return _read(part, self.name, setting, gcode, cut_ratio=cut_ratio)


def find_peers() -> tuple[PrusaSlicer | None, CuraEngine | None, list[str]]:
    """The peers that are installed, and a line for each that is not."""
    absent = []
    prusa = PrusaSlicer() if shutil.which(PrusaSlicer.program) else None
    if prusa is None:
        absent.append(f"{PrusaSlicer.program} is not installed: skipped")
    definitions = find_definitions()
    cura = None
    if not shutil.which(CuraEngine.program):
        absent.append(f"{CuraEngine.program} is not installed: skipped")
    elif definitions is None:
        absent.append(
            f"{CuraEngine.program} is skipped: fdmprinter.def.json was not found; "
            "name its folder in CURA_DEFINITIONS"
        )
    else:
        cura = CuraEngine(definitions)
    return prusa, cura, absent


def _read(part: Part, peer: str, setting: str, gcode: Path, *, cut_ratio: float) -> Printed:
    """The layers of a file and the time of its moves.

    Raises:
        RunError: there are none.
    """
    printer = part.profile.printer
    moves = read_moves(split_gcode(gcode.read_bytes()).commands, printer.corners[0])
    top = np.sort(np.array(moves.heights()))
    if len(top) == 0:
        raise RunError(f"{peer} laid no plastic: {gcode.name}")
    plan = LayerPlan.from_tops(top, f"{peer}, {setting}", cut_ratio=cut_ratio)
    return Printed(
        peer, setting, plan, gcode, moves.seconds(limits_of(printer)), float(moves.delta[:, 3].sum())
    )


def _digest(part: Part, name: str, words: Sequence[str], more: bytes = b"") -> str:
    """What decides the output of a run, in short."""
    text = "\0".join([part.digest, name, *words]).encode()
    return sha256(text + more).hexdigest()[:12]


def _file_name(setting: str) -> str:
    return re.sub(r"[^\w.]+", "_", setting)
