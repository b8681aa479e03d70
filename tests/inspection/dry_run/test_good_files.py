"""Good files of this and of other slicers: a dry run finds nothing wrong with them."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks.peers import Part, find_peers
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.profile import Profile, load_profile
from printer_slicer.slice_jobs import job_from, job_of
from tests.effort import few_of
from tests.parts import box, cone, sphere, step_pyramid, two_boxes
from tests.waiting import LAST_RESORT

PARTS = Path(__file__).parents[3] / "sample_parts"
PROFILE = load_profile("marlin_220", "pla", "standard")
BRIDGE, VASE = (
    Mesh(mesh.triangles / 3, name)
    for name, mesh in ((name, load_mesh(PARTS / f"{name}.stl")) for name in ("bridge", "vase"))
)
"""A third as large as the sample parts."""


def sound(verdict: Verdict) -> None:
    """Assert that nothing is wrong."""
    assert verdict.problems == ()
    assert verdict.identical
    assert verdict.simulated_seconds == pytest.approx(verdict.modelled_seconds, rel=1e-3)


def placed(mesh: Mesh) -> Mesh:
    """The part in the middle of the bed, where other slicers leave it."""
    low, high = mesh.bounds
    return mesh.moved((110 - (low + high)[0] / 2, 110 - (low + high)[1] / 2, -low[2]))


# Ours


@pytest.mark.parametrize(
    ("part", "changes"),
    [
        (BRIDGE, {}),
        (VASE, {"spiral": True}),
        (cone(5, 3), {"relative_extrusion": False}),
        (cone(5, 3), {"flavour": "klipper"}),
        (cone(5, 3), {"firmware_retraction": True}),
        (cone(5, 3), {"arc_tolerance": 0.02}),
        (cone(5, 3), {"planner.kind": "uniform", "printer.z_hop": 0.4}),
        (two_boxes((8, 8, 2), gap=10), {}),
        (step_pyramid((20.0, 12.0), (2.0, 2.0)), {"infill": "gyroid"}),
        (box((15, 15, 2)), {"raft_height": 0.6}),
        (box((15, 15, 2)), {"ironing": True, "infill_density": 1}),
    ],
    ids=str,
)
def test_our_files_pass(part: Mesh, changes: dict[str, object]) -> None:
    profile = load_profile("marlin_220", "pla", "standard", changes)

    sound(dry_run(job_of(part, profile), profile))


# PrusaSlicer's and Slic3r's


def sliced_by(
    program: str, folder: Path, parts: list[Mesh], *flags: str, profile: Profile = PROFILE
) -> Verdict:
    """The verdict on the file that a slicer makes of some parts, with its own settings but these."""
    if not shutil.which(program):
        pytest.skip(f"{program} is not installed")
    models = [str(folder / f"part_{number}.stl") for number in range(len(parts))]
    for model, part in zip(models, parts, strict=True):
        export_stl(part, model)
    file = folder / "file.gcode"
    command = [program, *models, "--output", str(file), *flags]
    subprocess.run(command, check=True, capture_output=True, timeout=LAST_RESORT)
    return dry_run(job_from(file, profile), profile)


PRUSA: dict[str, tuple[list[Mesh], tuple[str, ...]]] = {
    "supports": ([sphere(4)], ("--support-material",)),
    "vase": (
        [VASE],
        ("--spiral-vase", "--perimeters", "1", "--top-solid-layers", "0", "--fill-density", "0"),
    ),
    "relative": ([cone(5, 3)], ("--use-relative-e-distances", "--layer-gcode", "G92 E0")),
    "firmware retraction": ([cone(5, 3)], ("--use-firmware-retraction",)),
    "raft": ([box((15, 15, 2))], ("--raft-layers", "3")),
    "several parts": ([cone(5, 3), box((10, 10, 4))], ("--merge",)),
    "lift and wipe": ([step_pyramid((20.0, 12.0), (2.0, 2.0))], ("--retract-lift", "0.4", "--wipe")),
    "variable widths": ([sphere(4)], ("--perimeter-generator", "arachne", "--fill-pattern", "gyroid")),
    "plain": ([sphere(4)], ()),
    "bridge": ([BRIDGE], ()),
    "soluble supports": ([sphere(4)], ("--support-material", "--support-material-contact-distance", "0")),
    "marlin 2": ([cone(5, 3)], ("--gcode-flavor", "marlin2")),
}


@pytest.mark.parametrize("name", few_of(list(PRUSA), 8))
def test_files_of_prusaslicer_pass(name: str, tmp_path: Path) -> None:
    parts, flags = PRUSA[name]
    sound(sliced_by("prusa-slicer", tmp_path, parts, "--export-gcode", "--center", "110,110", *flags))


@pytest.mark.parametrize("flavour", ["reprapfirmware", "smoothie", "repetier"])
def test_files_for_other_firmwares_pass_on_printers_with_these(flavour: str, tmp_path: Path) -> None:
    profile = load_profile("marlin_220", "pla", "standard", {"flavour": flavour})
    flags = ("--export-gcode", "--center", "110,110", "--gcode-flavor", flavour)

    sound(sliced_by("prusa-slicer", tmp_path, [cone(5, 3)], *flags, profile=profile))


def test_a_file_for_another_firmware_is_found_out(tmp_path: Path) -> None:
    """RepRapFirmware heats with G10, which Marlin takes for a retraction."""
    flags = ("--export-gcode", "--center", "110,110", "--gcode-flavor", "reprapfirmware")
    verdict = sliced_by("prusa-slicer", tmp_path, [cone(5, 3)], *flags)

    assert {fault.code for fault in verdict.faults if fault.is_error} == {"cold"}


SLIC3R: dict[str, tuple[list[Mesh], tuple[str, ...]]] = {
    "plain": ([sphere(4)], ()),
    "bridge": ([BRIDGE], ()),
    "supports": ([sphere(4)], ("--support-material",)),
    "relative": ([cone(5, 3)], ("--use-relative-e-distances", "--layer-gcode", "G92 E0")),
    "firmware retraction": ([cone(5, 3)], ("--use-firmware-retraction",)),
    "vase": (
        [VASE],
        ("--spiral-vase", "--perimeters", "1", "--top-solid-layers", "0"),
    ),
}


@pytest.mark.parametrize("name", SLIC3R)
def test_files_of_slic3r_pass(name: str, tmp_path: Path) -> None:
    parts, flags = SLIC3R[name]
    sound(sliced_by("slic3r", tmp_path, parts, "--print-center", "110,110", *flags))


# CuraEngine's

CURA: dict[str, tuple[Mesh, dict[str, object]]] = {
    "plain": (sphere(4), {}),
    "bridge": (BRIDGE, {}),
    "supports": (sphere(4), {"support_enable": True}),
    "tree supports": (sphere(4), {"support_enable": True, "support_structure": "tree"}),
    "vase": (VASE, {"magic_spiralize": True}),
    "relative": (cone(5, 3), {"relative_extrusion": True}),
    "firmware retraction": (cone(5, 3), {"machine_firmware_retract": True}),
    "raft": (box((15, 15, 2)), {"adhesion_type": "raft"}),
}


@pytest.mark.parametrize("name", CURA)
def test_files_of_curaengine_pass(name: str, tmp_path: Path) -> None:
    _, cura, _ = find_peers()
    if cura is None:
        pytest.skip("CuraEngine or its definitions are not installed")
    mesh, changes = CURA[name]
    part = Part(placed(mesh), PROFILE, tmp_path)
    cura.uniform(part, 0.2, **changes)

    sound(dry_run(job_from(next(tmp_path.glob("*.gcode")), PROFILE), PROFILE))
