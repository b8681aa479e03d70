"""The same start and end G-code filled in by PrusaSlicer and by this program."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from printer_slicer import job_of, load_mesh
from tests.importing.files import imported, loaded

PART = Path(__file__).parents[2] / "sample_parts" / "box.stl"
SETTINGS = """\
layer_height = 0.2
first_layer_height = 0.2
gcode_flavor = marlin2
bed_shape = 0x0,220x0,220x200,0x200
temperature = 213
first_layer_temperature = 217
bed_temperature = 60
first_layer_bed_temperature = 65
max_layer_height = 0.3
max_print_height = 240
retract_lift = 0.4
printer_notes = MODEL_X with notes
z_offset = 0
filament_type = PETG
"""
START = """\
{temperature[0] / 4} {temperature[0] / 4.0} {-7 / 2} {-7 % 3} {7 % -3} {7.5 % 2} {2 * 3 / 12} {1 / 4.0}
{temperature[0]} [temperature] [temperature_0] {temperature[5]} [first_layer_temperature[initial_tool]] [filament_type]
{min(1, 2.5)} {max(3, 1)} {max(1.0, 2)} {int(-1.7)} {round(-1.5)} {round(2.5)} {- -3} {+3} {(1 < 2 ? 5 : 6)}
{"a" + 1 + 1.5} {"a" + true} {"}"} }} {digits(3.14159, 8, 2)}|{zdigits(7, 3)}|{digits(7, 3)}|{zdigits(-7, 5)}
{if layer_height < 0.3}A{elsif layer_height < 0.5}B{else}C{endif}{if nozzle_diameter[0] == 0.6}D{endif}
{if printer_notes =~ /.*MODEL_X.*/ and not has_wipe_tower}E{endif}{if "abc" =~ /b/}F{endif}{if "abc" !~ /b/}G{endif}
{if 1 == 1.0}H{endif}{if "a" < "b" or false}I{endif}{if !has_wipe_tower and (1 != 2)}J{endif}
{if 1 < 2 ? true : false}K{endif}
{print_bed_min[0]} {print_bed_max[1]} {print_bed_size[0]} {initial_extruder} {total_layer_count} {num_objects}
{if true
}over{endif} {min(nozzle_diameter[0],
1)} {if filament_type[0] == "PETG"}
in a branch
{endif}
{input_filename_base} [layer_height] {first_layer_height} {z_offset + 1}"""
END = "{layer_num} {layer_z} {max_layer_z} [layer_z] {min(max_layer_z + 5, max_print_height)} {total_layer_count}"


def marked(text: str) -> str:
    return ";===\\n" + text.replace("\\", "\\\\").replace("\n", "\\n") + "\\n;==="


def macros_in(gcode: str) -> list[list[str]]:
    found = re.findall(r"^;===\n(.*?)^;===$", gcode, re.DOTALL | re.MULTILINE)
    return [[line.strip() for line in text.splitlines() if line.strip()] for text in found[:2]]


@pytest.mark.skipif(not shutil.which("prusa-slicer"), reason="PrusaSlicer is not installed")
def test_macros_come_out_as_prusaslicer_fills_them_in(tmp_path: Path) -> None:
    config, gcode, part = tmp_path / "box.ini", tmp_path / "box.gcode", tmp_path / "box.stl"
    heats = "M104 S1\\nM140 S1\\n"
    macros = f"start_gcode = {heats}{marked(START)}\nend_gcode = {marked(END)}\n"
    config.write_text(SETTINGS + macros, encoding="utf-8")
    shutil.copy(PART, part)
    command = ["prusa-slicer", "--load", str(config), "-g", "-o", str(gcode), str(part)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    made = imported(config)
    profile = loaded(made, tmp_path)
    ours = job_of(load_mesh(part), profile).text.decode()

    assert gcode.exists(), done.stdout + done.stderr
    assert macros_in(ours) == macros_in(gcode.read_text(encoding="utf-8"))
    assert len(macros_in(ours)[0]) > 10
