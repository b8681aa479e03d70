"""Other slicers: how to run them with our settings, and which layers they print.

Layers are read from their G-code: every z of an extrusion along x or y is the top of a layer, which reaches down to the
layer below. Minutes are those of the file's moves on our machine model, from the first move to the last.

These observations were made with PrusaSlicer 2.5.0 and CuraEngine 4.13.0:

- PrusaSlicer prints any stack of layers that a stepped profile in a 3MF file describes. On four parts with random
  heights between 0.1 and 0.3 mm, every z was within 0.0005 mm, the rounding of its G-code, and no layer was missing. It
  prints nothing in a tip too thin for an extrusion. It adds layers above a stack that ends too low by more than half of
  its last layer. It resamples its own adaptive profile: 314 of 315 layers of benchy remained, some of them 0.10 mm away
  from the result of the rule, and the top was 0.017 mm too low.
- The cut height of a layer was measured on a cone with one perimeter. It is the share of the layer height at which the
  part is as wide as the print: 0.55 to 0.57 with PrusaSlicer, 0.51 with CuraEngine's uniform layers and 1.02 with its
  adaptive layers. So they are cut in the middle, in the middle and at the top.
- CuraEngine, unlike Cura, does not evaluate settings that follow from others (see `cura_settings`). It only supports
  shells as a number of layers of the nominal height.
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
    """A part that several slicers print with the settings of one profile.

    Attributes:
        mesh: the part, standing on z = 0 in the middle of the bed.
        profile: the settings; a planner may choose heights from `thinnest` to `thickest`.
        folder: for input and output files of the slicers.
    """

    mesh: Mesh
    profile: Profile
    folder: Path

    @property
    def heights(self) -> HeightLimits:
        """Return the layer heights that a peer may choose from."""
        quality = self.profile.quality
        first = quality.first_layer_height or quality.layer_height
        return HeightLimits(first, self.profile.thinnest, quality.layer_height, self.profile.thickest)

    @cached_property
    def model(self) -> str:
        """Return the part as the model of a 3MF file."""
        return model_xml(self.mesh)

    @cached_property
    def stl(self) -> Path:
        """Return the part as STL, standing on z = 0 over the origin, which CuraEngine puts in the middle of the bed."""
        path = self.folder / f"{self.mesh.name}.centred.stl"
        x, y = np.mean(self.profile.printer.corners, axis=0).tolist()
        export_stl(self.mesh.moved((-x, -y, 0.0)), path)
        return path

    @cached_property
    def digest(self) -> str:
        """Return a checksum of part and profile."""
        return sha256(self.mesh.triangles.tobytes() + repr(self.profile).encode()).hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class Printed:
    """A peer's result for a part.

    Attributes:
        peer: name and version.
        setting: its settings for layers.
        plan: the tops of its layers, and the heights at which it cut the part.
        gcode: the file.
        seconds: modelled time of its moves on our machine, without homing and heating.
        filament: filament that its moves feed, mm.
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
        """Take the perimeter generator, `classic` or `arachne` (the default), and further settings."""
        said = subprocess.run([self.program, "--help"], capture_output=True, text=True, check=False).stdout
        found = re.search(r"PrusaSlicer-([\d.]+)", said)
        self.name = f"PrusaSlicer {found[1] if found else '(unknown version)'}"
        self.name += "" if walls == "classic" else f" {walls}"
        self.name += "".join(f" {key.replace('_', ' ')} {value}".rstrip() for key, value in more.items())
        self._walls = walls
        self._more = {key.replace("_", "-"): value for key, value in more.items()}

    def uniform(self, part: Part, height: float) -> Printed:
        """Slice with layers of one height, mm, after the first."""
        return self._sliced(part, f"uniform {height:g}", height)

    def adaptive(self, part: Part, quality: float) -> Printed:
        """Slice with its own adaptive layers, within the part's range; quality 0 is finest, 1 coarsest."""
        profile = adaptive_profile(part.mesh, part.heights, quality)
        return self._sliced(part, f"adaptive {quality:g}", part.heights.nominal, profile)

    def stack(self, part: Part, plan: LayerPlan) -> Printed:
        """Slice any stack of layers; the plan of the result shows what PrusaSlicer changed."""
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
    """CuraEngine's command line. It cuts uniform layers in their middle, adaptive layers at their top.

    It models extrusions as rectangles. At the same width, its lines are one width apart and contain more material than
    ours, whose sides are round. With `same_beads`, its line width is our line spacing, and both contain equal volumes
    per mm.
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
        """Slice with layers of one height, mm, after the first, and with `more` of its settings."""
        settings: dict[str, object] = {"layer_height": height, **more}
        if self._same_beads:
            settings["line_width"] = round(float(bead.spacing(part.profile.extrusion_width, height)), 4)
        return self._sliced(part, f"uniform {height:g}", settings, cut_ratio=0.5)

    def adaptive(self, part: Part, threshold: float, step: float = 0.01, **more: object) -> Printed:
        """Slice with adaptive layers: `threshold` is how far stairs may extend, `step` how fast heights change, mm.

        `more` are further settings of it.

        It has one variation for both directions, so its heights are nominal ± the wider side of the part's range.
        """
        heights = part.heights
        variation = max(heights.nominal - heights.thinnest, heights.thickest - heights.nominal)
        settings = {
            "layer_height": heights.nominal,
            "adaptive_layer_height_enabled": True,
            "adaptive_layer_height_variation": round(variation, 6),
            "adaptive_layer_height_variation_step": step,
            "adaptive_layer_height_threshold": threshold,
            **more,
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
    """Return the installed peers, and a line for each missing one."""
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
    """Read the layers of a file and the time of its moves.

    Raises:
        RunError: the file has no layers.
    """
    printer = part.profile.printer
    moves = read_moves(split_gcode(gcode.read_bytes()).commands, printer.corners[0])
    top = np.sort(np.array(moves.heights()))
    if len(top) == 0:
        raise RunError(f"{peer} extruded nothing: {gcode.name}")
    plan = LayerPlan.from_tops(top, f"{peer}, {setting}", cut_ratio=cut_ratio)
    return Printed(
        peer, setting, plan, gcode, moves.seconds(limits_of(printer)), float(moves.delta[:, 3].sum())
    )


def _digest(part: Part, name: str, words: Sequence[str], more: bytes = b"") -> str:
    """Return a checksum of everything that decides the output of a run."""
    text = "\0".join([part.digest, name, *words]).encode()
    return sha256(text + more).hexdigest()[:12]


def _file_name(setting: str) -> str:
    return re.sub(r"[^\w.]+", "_", setting)
