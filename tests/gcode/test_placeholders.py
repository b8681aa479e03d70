"""What start, end and layer G-code can speak of, and where it stands."""

from __future__ import annotations

from typing import Any

import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.gcode import write_gcode
from printer_slicer.gcode.facts import collect_print_facts
from printer_slicer.gcode.inserted_lines import read_macro
from printer_slicer.model import Program
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import Profile, profile_with
from printer_slicer.roles import Role
from tests.parts import box, plain, profile


@pytest.fixture(scope="module")
def program() -> Program:
    return slice_part(box((20, 10, 2)), plain())


def with_start(text: str, **changes: Any) -> Profile:
    return plain(start_gcode=text, **changes)


def filled(program: Program, wanted: Profile) -> list[str]:
    return read_macro(wanted, "start_gcode").render(collect_print_facts(program, wanted))


def test_names_become_numbers_without_needless_zeros(program: Program) -> None:
    wanted = with_start(
        "M109 S{first_layer_nozzle_temperature}\nG1 Z{z_step}", first_layer_nozzle_temperature=215
    )

    assert filled(program, wanted) == ["M109 S215", "G1 Z0.01"]


def test_settings_of_supports_have_the_names_of_other_slicers(program: Program) -> None:
    text = "{if support_material}on{else}off{endif} [support_material_threshold] {support_angle} {enable_support}"
    wanted = with_start(text, support="tree", support_threshold_deg=35)
    off = with_start("{if support_material or not support_material_auto}on{else}off{endif}")

    assert filled(program, wanted) == ["on 35 55 true"]
    assert filled(program, off) == ["off"]


def test_a_name_may_say_its_section(program: Program) -> None:
    wanted = with_start(
        "{material.nozzle_temperature} {quality.layer_height} {quality.speeds.travel} {speeds.travel}"
    )

    assert filled(program, wanted) == ["210 0.2 150 150"]


def test_sections_have_their_names(program: Program) -> None:
    wanted = with_start("{printer_name}|{material_name}|{quality_name}")

    assert filled(program, wanted) == [
        "|".join(x.name for x in (wanted.printer, wanted.material, wanted.quality))
    ]


def test_facts_about_the_part_are_known(program: Program) -> None:
    wanted = with_start("{layer_count} {part_height} {first_layer_min_x} {first_layer_max_y}")

    assert filled(program, wanted) == ["10 2 -9.775 4.775"]


def test_a_bed_from_its_corner_has_its_middle_at_half_its_width(program: Program) -> None:
    wanted = with_start("{bed_x_middle} {bed_y_end}", origin="corner", bed_x=220, bed_y=200)

    assert filled(program, wanted) == ["110 195"]


def test_the_first_layer_reaches_from_its_first_bead_to_its_last() -> None:
    """Also where paths are open: their first points count too."""
    lines = slice_part(
        box((20, 10, 2)), plain(perimeters=0, infill_density=1, infill_angle_deg=0, infill_overlap=0)
    )
    known: Any = collect_print_facts(lines, plain())
    first = (lines.layer == 0) & (lines.role != Role.TRAVEL)

    assert known["first_layer_min_x"] == pytest.approx(
        min(lines.xyz[first, 0].min(), lines.start[first, 0].min()), abs=1e-4
    )
    assert known["first_layer_max_y"] == pytest.approx(
        max(lines.xyz[first, 1].max(), lines.start[first, 1].max()), abs=1e-4
    )


def test_a_bed_around_its_middle_has_its_middle_at_zero(program: Program) -> None:
    wanted = with_start("{bed_x_middle} {bed_y_end}", origin="centre", bed_y=200)

    assert filled(program, wanted) == ["0 95"]


def test_spaces_within_braces_do_not_matter(program: Program) -> None:
    assert filled(program, with_start("G4 P{ layer_count }")) == ["G4 P10"]


def test_text_without_names_is_kept_line_by_line(program: Program) -> None:
    assert filled(program, with_start("\nG28 ; home\n\nG90\n")) == ["G28 ; home", "", "G90"]


@pytest.mark.parametrize("setting", ["start_gcode", "end_gcode"])
def test_an_unknown_name_is_an_error_that_names_the_setting_and_the_likely_name(
    program: Program, setting: str
) -> None:
    wanted = plain(**{setting: "M104 S{nozle_temperature}"})

    with pytest.raises(ProfileError) as caught:
        write_gcode(program, wanted)

    assert setting in str(caught.value)
    assert wanted.printer.name in str(caught.value)
    assert "{nozle_temperature}" in str(caught.value)
    assert "{nozzle_temperature}" in caught.value.remedy


def test_a_name_like_no_other_lists_the_known_ones(program: Program) -> None:
    with pytest.raises(ProfileError) as caught:
        write_gcode(program, with_start("{qqqqqq}"))

    assert "layer_count" in caught.value.remedy


def test_macros_cannot_hold_each_other(program: Program) -> None:
    with pytest.raises(ProfileError, match="unknown placeholder"):
        write_gcode(program, with_start("{end_gcode}"))


@pytest.mark.parametrize("name", ["marlin_220", "marlin_220_06", "corexy_klipper"])
def test_the_shipped_macros_have_no_open_names(program: Program, name: str) -> None:
    wanted = profile(name)
    text = write_gcode(program, wanted)

    assert b"{" not in text.partition(b"; settings\n")[0]
    assert f"M109 S{wanted.material.first_layer_nozzle_temperature:g}".encode() in text


def test_every_setting_can_be_said(program: Program) -> None:
    """All keys that are written at the end of a file are names, but for the macros themselves."""
    from printer_slicer.profile import list_settings

    wanted = plain()
    keys = [key for key, _ in list_settings(wanted) if not key.endswith("_gcode")]
    text = profile_with(wanted, {"start_gcode": "\n".join(f"{{{key}}}" for key in keys)})

    assert len(filled(program, text)) == len(keys) > 60
