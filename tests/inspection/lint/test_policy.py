"""What is found in G-code before a printer gets it: each kind alone, well-behaved files, and names that allow."""

from __future__ import annotations

import json
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.peers import Part, find_peers
from printer_slicer.cli import main
from printer_slicer.diagnostics import (
    NAMES,
    Diagnostic,
    check_allowed_codes,
    format_remedies,
    raise_on_errors,
)
from printer_slicer.errors import PolicyError, PortError, UsageError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.lexer import strip
from printer_slicer.gcode.reader import MoveReader
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.inspection.lint.syntax import describe_lower_case_fault
from printer_slicer.mesh_io import load_mesh
from printer_slicer.printing import print_job
from printer_slicer.profile import load_profile, profile_with
from printer_slicer.slice_jobs import job_from
from tests.waiting import LAST_RESORT

PARTS = Path(__file__).parents[3] / "sample_parts"
PROFILE = load_profile()
GOOD = """\
G21
G90
M83
M140 S60
M104 S215
G28
M190 S60
M109 S215
G1 Z0.3 F300
G1 X2 Y20 F6000
G1 X2 Y120 E9 F1200
;LAYER:0
G1 X50 Y50 F6000
G1 X150 Y50 E3.3 F1800
;LAYER:1
G1 Z0.5 F300
G1 X150 Y150 E3.3 F1800
G1 E-5 F1500
M104 S0
M140 S0
G1 X5 Y220 F6000
M84
"""
GOOD_LINES = GOOD.splitlines()
COMMANDS = [line.encode() for line in GOOD_LINES if not line.startswith(";")]


def found(*lines: str, printer: str | None = None) -> tuple[Diagnostic, ...]:
    """What is found in these commands alone."""
    return scan([line.encode() for line in lines], load_profile(printer))


def names(*lines: str, printer: str | None = None) -> list[tuple[str, bool]]:
    return [(one.code, one.is_error) for one in found(*lines, printer=printer)]


def refused(*lines: str, printer: str | None = None) -> list[str]:
    return [one.code for one in found(*lines, printer=printer) if one.is_error]


# Every kind


HARM = {
    "temperature": [
        *(
            "M104 S261",
            "M109 R300",
            "M140 S111",
            "M190 R120",
            "M104 T1 S400",
            "G10 P0 R20 S280",
            "M568 P0 S290",
        ),
        *("M104 S{global.hot}", "M104 S2E3", "M104 S200 S300", "START_PRINT BED_TEMP=60 EXTRUDER_TEMP=290"),
        *("SET_HEATER_TEMPERATURE HEATER=extruder TARGET=270", "START_PRINT BED_TEMP=150"),
    ],
    "box": ["G1 X300", "G1 Y-30", "G1 Z-0.5", "G1 Z300", "G1 X226 E1"],
    "feed": ["G1 X100 F90000"],
    "flow": ["G1 X100 E50 F6000"],
    "ratio": ["M221 S50", "M221 S200", "M220 S10", "M220 S400"],
    "cold": ["M302 S0", "M302 P1", "M302 S100"],
    "eeprom": ["M500", "M501", "M502", "M504", "SAVE_CONFIG"],
    "limits": ["M201 X20000", "M203 X30000", "M204 S50000", "M205 X500"],
    "calibration": ["M92 E500", "M301 P30", "M304 P30", "M305 P0 B4000"],
    "autotune": ["M303 E0 S200 C8", "PID_CALIBRATE HEATER=extruder TARGET=200"],
    "protection": ["M143 S500", "M562", "M570 H1 P60 T100"],
    "endstops": ["M211 S0", "M564 S0 H0", "FORCE_MOVE STEPPER=stepper_z DISTANCE=-50 VELOCITY=5"],
    "offsets": ["M206 Z-5", "M428", "M851 Z-9", "G54", "G10 L2 P1 X50", "M290 Z-2", "SET_GCODE_OFFSET Z=-2"],
    "halt": ["M112", "M410"],
    "wait": ["M0", "M1", "M0 Click to go on"],
    "firmware": ["M997", "M999", "FIRMWARE_RESTART"],
    "files": ["M23 evil.g", "M24", "M28 file.g", "M30 file.g", "M928 log.txt"],
    "pins": ["M42 P4 S255", "M43"],
    "macros": ["M810 G28|M104 S400"],
    "link": ["M575 P0 B9600", 'M587 S"net" P"key"', "M118 ok", "M118 E1 A1 Resend: 7", "M118 !! no"],
    "debug": ["D3 Ax0000", "D-1", "M111 S8"],
    "shell": ["RUN_SHELL_COMMAND CMD=rm"],
    "unreadable": ["G1 X{random(400)}", "M107 G1 X500", "while true", "G5 X500 Y0 I0 J3 P0 Q-3", "G18"],
}
HARM["unreadable"] += [
    "G1 X",
    "G1 Xnan",
    "G1 X1 Y-inf",
    "G1 X1.2.3 Y5",
    "G1 Y.",
    "G92 E",
    "M104 Snan",
    "M204 P1.2.3",
]
OF_WHOLE_JOBS = {"unsupported", "head", "homing"}


def test_every_name_has_an_example() -> None:
    assert set(HARM) | OF_WHOLE_JOBS == set(NAMES)


@pytest.mark.parametrize(("name", "line"), [(name, line) for name, lines in HARM.items() for line in lines])
def test_each_kind_is_refused_by_its_name(name: str, line: str) -> None:
    assert name in refused(line)


@pytest.mark.parametrize(("name", "line"), [(name, line) for name, lines in HARM.items() for line in lines])
def test_each_kind_is_found_in_the_middle_of_a_good_job_whatever_its_spelling(name: str, line: str) -> None:
    for spelt in (line, line.lower(), f"N7 {line}*99", line.replace(" ", "  "), f" {line}"):
        at = 14
        job = [*COMMANDS[:at], strip(spelt.encode()), *COMMANDS[at:]]  # as files are read
        hits = [one for one in scan(job, PROFILE) if one.is_error and one.code == name]

        assert [one.index for one in hits][:1] == [at], spelt


def test_a_fault_far_behind_in_a_long_job_is_found_at_its_place() -> None:
    job = [*COMMANDS, *(b"G1 X%d Y10" % (10 + nth % 2) for nth in range(33_000)), b"M104 S400"]

    assert [one.index for one in scan(job, PROFILE) if one.code == "temperature"] == [len(job) - 1]


HARMLESS = [
    *("M104 S260", "M109 R200", "M140 S0", "M104", "M109", "M105", "M106 S255", "M107", "M115", "M117 M112"),
    *("M302", "M302 S170", "M503", "M201 X500 Y500 Z100 E5000", "M203 X500 Y500 Z5 E25", "M204 S500"),
    *(
        "M205 X10 Y10 Z0.3 E5",
        "M92",
        "M301",
        "M211",
        "M211 S1",
        "M851",
        "M73 P10 R20",
        "M220 S100",
        "M221 S100",
        "M220 B",
        "M220 R",
    ),
    *("G1 X5. Y.5 E-.5 F1200", "G1X5Y5", "G2 X5 Y5 I1 J-1 E.1", "M106", "M109 S200 F"),
    *(
        "M118 S500 G1 X999",
        "M118 okay then",
        "M290",
        "M290 R0 S0",
        "M84",
        "M82",
        "G28",
        "G28 X Y",
        "G29",
        "G4 P500",
        "T0",
        "M486 S1",
        "M900 K0.05",
    ),
    *('M862.3 P "MK3S"', "EXCLUDE_OBJECT_START NAME=a", "SET_PRESSURE_ADVANCE ADVANCE=0.05", "M420 S1"),
    *("PRINT_START EXTRUDER_TEMP=215 BED_TEMP=60", "M300 S440 P200", "M155 S2", "M10", "M400", "G10", "G11"),
]


@pytest.mark.parametrize("line", HARMLESS)
def test_what_files_usually_hold_is_passed_over(line: str) -> None:
    assert names(line) == []


def test_other_limits_are_told_if_they_are_a_little_over() -> None:
    assert names("M201 X9000 Y9000 Z500 E10000") == [("limits", False)]
    assert names("M203 X500 Y500 Z12 E120") == [("limits", False)]


def test_limits_in_mm_per_minute_are_right_for_reprapfirmware_alone(tmp_path: Path) -> None:
    rrf = profile_with(PROFILE, {"printer.flavour": "reprapfirmware"})

    assert [one.code for one in scan([b"M203 X30000 Y30000 Z300 E1500"], rrf)] == []
    assert refused("M203 X30000 Y30000 Z300 E1500") == ["limits"]


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize(
    ("line", "known_to"),
    [
        ("M566 X6000 Y6000", {"reprapfirmware"}),
        ("SET_VELOCITY_LIMIT ACCEL=9000", {"klipper"}),
        ("M204 P9000 T9000", set(FLAVOURS) - {"repetier"}),
    ],
)
def test_limits_are_judged_where_the_firmware_knows_the_command(
    flavour: str, line: str, known_to: set[str]
) -> None:
    profile = profile_with(PROFILE, {"printer.flavour": flavour, "printer.corner": "jerk"})
    told = [one for one in scan([line.encode()], profile) if one.code == "limits"]

    assert bool(told) == (flavour in known_to)


@pytest.mark.parametrize(
    "line", ["g1 x5", "G1 x5", "m104 S200", "N5 g1 X5", "m117 hello", "G1 X5y5", "M106 s255"]
)
def test_lower_case_is_refused_where_the_firmware_does_not_know_it(line: str) -> None:
    (finding,) = found(line)
    takes = [name for name in sorted(FLAVOURS) if not describe_lower_case_fault(line.encode(), name)]

    assert (finding.code, finding.is_error) == ("unreadable", True)
    assert finding.message.startswith("is in lower case, which Marlin does not read: write ")
    assert takes == ["klipper", "repetier", "reprapfirmware"]


@pytest.mark.parametrize(
    "line",
    [
        "M117 x 5",
        'M862.3 P "mk3 s"',
        "M1002 gcode_claim_action : 0",
        "G1 X5 (x 5)",
        "@pause",
        "set_pin pin=x value=1",
        "M104 S{first_layer}",
    ],
)
def test_texts_and_names_may_be_in_lower_case(line: str) -> None:
    assert not any(describe_lower_case_fault(line.encode(), name) for name in FLAVOURS)


def test_what_capitals_are_named_leaves_texts_as_they_are() -> None:
    assert describe_lower_case_fault(b"m117 hello x 5", "prusa").endswith("write M117 hello x 5")
    assert describe_lower_case_fault(b'm36 p"a b" s1 "c"', "marlin").endswith('write M36 p"a b" s1 "c"')
    assert describe_lower_case_fault(b'g1 x5 p"a b" s1 (c) y2', "marlin").endswith(
        'write G1 X5 P"a b" S1 (c) Y2'
    )


def test_a_wait_that_ends_by_itself_is_told() -> None:
    assert names("M0 S10") == [("wait", False)]
    assert names("M600") == [("wait", False)]
    assert names("M290 Z0.05") == [("offsets", False)]
    assert names("M118 // action:pause") == [("link", False)]
    assert names("M81") == [("halt", False)]


def test_line_numbers_are_the_hosts() -> None:
    """In capitals the host leaves it out by itself."""
    assert "link" in refused("m110 n5")


def test_an_arc_that_bulges_out_is_found_though_it_ends_inside() -> None:
    assert names("G1 X100 Y20 F3000", "G2 X120 Y20 I10 J0") == []
    assert refused("G1 X100 Y20 F3000", "G3 X100.1 Y20 I0 J-50") == ["box"]


# Units, modes, offsets, tools


def test_temperatures_in_other_units_are_understood() -> None:
    assert refused("M149 F", "M104 S428") == []  # 220 °C
    assert refused("M149 K", "M104 S493") == []
    assert refused("M149 F", "M104 S600") == ["temperature"]
    assert refused("M149 F", "M149 C", "M104 S428") == ["temperature"]


def test_a_whole_job_has_to_home_and_to_heat() -> None:
    """Single commands, such as a person types, need not."""
    cold = [one for one in COMMANDS if not one.startswith((b"M104", b"M109"))]
    lost = [one for one in COMMANDS if not one.startswith(b"G28")]

    for job, name in ((cold, "cold"), (lost, "homing")):
        assert [one.code for one in scan(job, PROFILE, whole=True)] == [name]
        assert scan(job, PROFILE) == ()
    assert scan(COMMANDS, PROFILE, whole=True) == ()


def test_another_tool_may_rest_and_the_same_may_be_cold_for_a_moment() -> None:
    at = COMMANDS.index(b"G1 X150 Y50 E3.3 F1800") + 1
    for pause in ([b"M104 T1 S0"], [b"M104 S0", b"G1 X60 F6000", b"M109 S215"], [b"M104 S0"]):
        assert scan([*COMMANDS[:at], *pause, *COMMANDS[at:]], PROFILE, whole=True) == ()


def test_a_macro_that_starts_the_print_is_trusted_to_home_and_to_heat() -> None:
    own = [one for one in COMMANDS if not one.startswith((b"G28", b"M104", b"M109", b"M140", b"M190"))]

    assert scan([b"PRINT_START EXTRUDER_TEMP=215 BED_TEMP=60", *own], PROFILE, whole=True) == ()


def test_inches_are_followed() -> None:
    assert refused("G20", "G1 X8 F100") == []
    assert refused("G20", "G1 X10 F100") == ["box"]
    assert refused("G20", "G21", "G1 X10 F100") == []


def test_relative_moves_add_up() -> None:
    step = ["G91", *["G1 X50 F3000"] * 4]

    assert refused(*step) == []
    assert refused(*step, "G1 X60") == ["box"]
    assert refused(*step, "G90", "G1 X60") == []


def test_an_offset_moves_no_wall() -> None:
    assert refused("G1 X100 F3000", "G92 X0", "G1 X110") == []
    assert refused("G1 X100 F3000", "G92 X0", "G1 X200") == ["box"]
    assert refused("G1 X100 F3000", "G92 X0", "G28", "G1 X200") == []


def test_filament_that_only_comes_back_is_no_flow() -> None:
    assert refused("M83", "G1 X10 E0.3 F1800", "G1 E-20 F1500", "G1 E20 F1500", "G1 X20 E0.3 F1800") == []


def test_filament_is_counted_for_each_tool() -> None:
    """A tool that was pulled back for the change comes back without flowing, whatever the other one did meanwhile."""
    swap = ["M83", "G1 X10 E0.3 F1800", "G1 E-10", "T1", "G1 X20 E0.3", "G1 E-10", "T0", "G1 E10 X20.5 F3000"]

    assert refused(*swap) == []


def test_absolute_and_relative_filament_come_to_the_same() -> None:
    absolute = found("M82", "G92 E0", "G1 X10 E5 F3000", "G92 E0", "G1 X20 E5")
    relative = found("M83", "G1 X10 E5 F3000", "G1 X20 E5")

    assert [(one.code, one.message, one.times) for one in absolute] == [
        (one.code, one.message, one.times) for one in relative
    ]
    assert [one.code for one in absolute] == ["flow"]


def test_a_ratio_of_flow_counts() -> None:
    bead = ["M83", "G1 X100 E12 F1800"]

    assert refused(*bead) == []
    assert refused("M221 S500", *bead) == ["ratio", "flow"]


def test_a_feed_that_the_firmware_holds_back_is_told_unless_the_file_lifts_the_limit() -> None:
    travel = "G1 X100 F36000"  # 600 mm/s, the profile has 500

    assert names(travel) == [("feed", False)]
    assert ("feed", True) in names("M203 X900", travel)


# Good files


def test_a_good_job_holds_nothing() -> None:
    assert scan(COMMANDS, PROFILE) == ()


@pytest.mark.parametrize(("printer", "material"), [("marlin_220", "pla"), ("voron_2_4_350", "abs")])
def test_our_own_files_hold_nothing(printer: str, material: str, tmp_path: Path) -> None:
    """Those of all printers and materials are looked at where they are printed."""
    profile = load_profile(printer, material, "standard")
    job = job_from(PARTS / "bridge.stl", profile)
    file = tmp_path / "bridge.gcode"
    file.write_bytes(job.text)

    assert job.findings == ()
    assert job_from(file, profile).findings == ()


def test_pauses_that_the_settings_ask_for_need_no_leave(tmp_path: Path) -> None:
    """In a file they do: whoever prints it may not know of them."""
    profile = load_profile(None, None, None, {"quality.pause_at": "2"})
    job = job_from(PARTS / "bridge.stl", profile)
    file = tmp_path / "bridge.gcode"
    file.write_bytes(job.text)

    assert [(one.code, one.command) for one in job.findings] == [("wait", "M0")]
    raise_on_errors(job.findings, job.allowed)
    with pytest.raises(PolicyError, match="M0"):
        raise_on_errors(job_from(file, profile).findings)


@pytest.mark.parametrize("flavour", ["marlin", "marlin2", "reprap", "reprapfirmware", "smoothie"])
def test_prusaslicers_files_are_not_refused(flavour: str, tmp_path: Path) -> None:
    if not shutil.which("prusa-slicer"):
        pytest.skip("PrusaSlicer is not installed")
    file = tmp_path / "box.gcode"
    command = ["prusa-slicer", "-g", str(PARTS / "box.stl"), "--gcode-flavor", flavour, "-o", str(file)]
    subprocess.run(command, check=True, capture_output=True, timeout=LAST_RESORT)
    job = job_from(file, PROFILE)

    assert len(job.commands) > 1000
    assert [one for one in job.findings if one.is_error] == []


def test_curas_files_are_not_refused(tmp_path: Path) -> None:
    _, cura, _ = find_peers()
    if cura is None:
        pytest.skip("CuraEngine or its definitions are not installed")
    profile = load_profile(None, None, "standard")
    mesh = load_mesh(PARTS / "box.stl")
    low, high = mesh.bounds
    part = Part(
        mesh.moved((110 - (low + high)[0] / 2, 110 - (low + high)[1] / 2, -low[2])), profile, tmp_path
    )
    cura.uniform(part, 0.2)
    job = job_from(next(tmp_path.glob("*.gcode")), profile)

    assert len(job.commands) > 1000
    assert [one for one in job.findings if one.is_error] == []


# Any file


LINES = st.one_of(
    st.sampled_from([line for lines in HARM.values() for line in lines] + HARMLESS + GOOD_LINES),
    st.binary(max_size=20).map(lambda data: data.replace(b"\n", b"").replace(b"\r", b"").decode("latin-1")),
    st.builds("G1 X{} Y{} F{}".format, *[st.integers(-400, 400)] * 2, st.integers(0, 90000)),
)


@given(st.lists(LINES, max_size=25))
def test_any_lines_can_be_scanned_and_findings_are_in_order(lines: list[str]) -> None:
    commands = [line.encode("latin-1") for line in lines]
    findings = scan(commands, PROFILE)

    assert all(0 <= one.index < len(commands) and one.times >= 1 for one in findings)
    assert all(before.index <= after.index for before, after in pairwise(findings))
    assert {one.code for one in findings} <= {*NAMES, "unknown"}


@given(st.lists(st.sampled_from(HARM["eeprom"] + HARM["halt"] + HARM["temperature"]), min_size=1, max_size=5))
def test_what_is_found_is_found_however_much_stands_around_it(harm: list[str]) -> None:
    bare = {(one.code, one.message) for one in scan([line.encode() for line in harm], PROFILE)}
    around = [*COMMANDS, *(line.encode() for line in harm), *COMMANDS]

    assert bare <= {(one.code, one.message) for one in scan(around, PROFILE)}


# Where, and allowing


def test_findings_know_line_and_layer(tmp_path: Path) -> None:
    file = tmp_path / "job.gcode"
    lines = [*GOOD_LINES[:16], "; a remark", "", "M500 ; oops", *GOOD_LINES[16:], "M500"]
    file.write_text("\n".join(lines))
    (finding,) = [one for one in job_from(file, PROFILE).findings if one.is_error]

    assert (finding.line, finding.layer, finding.command, finding.times) == (19, 2, "M500", 2)


def test_a_job_is_refused_by_line_until_every_name_is_allowed() -> None:
    findings = found("G28", "M500", "M104 S300")

    with pytest.raises(
        PolicyError, match=r"job: not printed: command 2: M500: stores.*\(and 1 more error\)"
    ) as caught:
        raise_on_errors(findings, name="job")
    assert caught.value.names == ("eeprom", "temperature")
    assert '`job.allowing(["eeprom", "temperature"])`' in caught.value.remedy
    with pytest.raises(PolicyError):
        raise_on_errors(findings, {"eeprom"})
    raise_on_errors(findings, {"eeprom", "temperature"})


@pytest.mark.parametrize("name", NAMES)
def test_every_finding_has_a_remedy_of_its_own_kind(name: str) -> None:
    """Another profile helps only against what is measured by the profile."""
    of_profile = {"temperature", "box", "feed", "flow", "limits", "unreadable"}
    remedy = format_remedies([Diagnostic(name, "error", "")])

    assert ("`printer`" in remedy) == (name in of_profile)
    assert ("supports" in remedy) == (name == "unsupported")
    assert remedy.endswith(f'. Use `job.allowing(["{name}"])` to print it anyway')


def test_each_of_several_findings_has_its_remedy() -> None:
    remedy = format_remedies(found("G28", "M500", "M104 S300", "M81", "M112"))

    assert remedy == (
        "eeprom, halt: Remove it from the G-code. "
        "temperature: Set `printer` and `material` to those that the file was sliced for. "
        'Use `job.allowing(["eeprom", "temperature", "halt"])` to print it anyway'
    )


def test_a_name_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(UsageError, match="everything"):
        check_allowed_codes(["everything"])
    assert check_allowed_codes(NAMES) == frozenset(NAMES)


def job_file(folder: Path, *lines: str) -> Path:
    path = folder / "job.gcode"
    path.write_text("\n".join([*GOOD_LINES, *lines]))
    return path


def test_print_refuses_before_the_port_is_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["print", str(job_file(tmp_path, "M500")), "--port", "/dev/there-is-none"])
    said = capsys.readouterr()

    assert code == 2
    assert "line 23, layer 2: M500: stores settings" in said.err
    assert "--allow eeprom" in said.err


def test_print_takes_what_is_allowed_and_lists_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(job_file(tmp_path, "M302 S0"))

    assert main(["print", file, "--port", "sim:", "--allow", "cold"]) == 0
    assert "M302 S0: allows extrusion" in capsys.readouterr().err
    assert main(["print", file, "--port", "sim:", "--allow", "clod"]) == 2


def test_print_lists_findings_as_an_event(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(job_file(tmp_path, "M302 S0"))

    assert main(["print", file, "--port", "sim:", "--allow", "cold", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    (event,) = [event for event in events if event["event"] == "findings"]
    assert [(one["name"], one["line"], one["allowed"]) for one in event["findings"]] == [("cold", 23, True)]


def test_a_dry_run_tells_everything_and_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(job_file(tmp_path, "M302 S0"))

    assert main(["dry-run", file, "--json"]) == 7
    facts = json.loads(capsys.readouterr().out)
    assert facts["ok"] is False
    assert [one["name"] for one in facts["findings"]] == ["cold"]
    assert main(["dry-run", file, "--allow", "cold"]) == 0


def test_the_function_that_prints_refuses_too(tmp_path: Path) -> None:
    job = job_from(job_file(tmp_path, "M302 S0"), PROFILE)

    with pytest.raises(PolicyError, match="M302"):
        print_job(job, PROFILE, "/dev/there-is-none")
    with pytest.raises(PortError):
        print_job(job.allowing(["cold"]), PROFILE, "/dev/there-is-none")


def test_the_help_names_everything_that_can_be_allowed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["print", "--help-all"])
    said = capsys.readouterr().out

    assert [name for name in NAMES if name not in said] == []


@pytest.mark.parametrize("size", [1, 2, 5])
def test_moves_that_come_piece_by_piece_are_judged_like_all_at_once(size: int) -> None:
    lines = ["G28", "M83", "G1 X400 F6000", "G1 X10", "M203 X900", "G1 X200 F50000", "G1 E-5", "M221 S200"]
    lines += ["G1 E5 F3000", "G1 X20 E9 F6000", "G1 X500 Y-9", "T1", "G1 X30 E9", "M203 X30", "G1 X90 F50000"]
    commands = [line.encode() for line in lines]
    reader, pieces = MoveReader(PROFILE.printer.corners[0]), []
    for at in range(0, len(commands), size):
        reader.feed(commands[at : at + size])
        pieces.append(reader.take_moves())

    found = scan(commands, PROFILE, moves=pieces)

    assert {"box", "feed", "flow"} <= {one.code for one in found}
    assert set(found) == set(scan(commands, PROFILE))


def test_a_command_that_no_firmware_knows_is_a_warning() -> None:
    found = scan([b"FOO BAR", b"FOO BAZ", b"M190 S60", b"G425"], PROFILE)
    klipper = load_profile("corexy_klipper")

    assert [(one.code, one.severity, one.command, one.times) for one in found] == [
        ("unknown", "warning", "FOO", 2)
    ]
    assert scan([b"FOO BAR"], klipper) == ()
