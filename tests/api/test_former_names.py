"""Names of the previous release work in this one, with a warning that gives the current name."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable
from inspect import getattr_static
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.inspection.coverage.limits import CoverageLimits
from printer_slicer.inspection.coverage.measurement import Coverage, CoverageRules
from printer_slicer.inspection.deposition.record import Deposition, LayerDeposition
from printer_slicer.model.plate_objects import Labels
from printer_slicer.printing import commands
from printer_slicer.sim.statistics import Report
from tests.parts import box

FORMER_FIELDS: Final[dict[type[Any], dict[str, str]]] = {
    ps.Certificate: {"looks": "drawable"},
    ps.Dialect: {"reads": "commands"},
    ps.Mesh: {"items": "objects", "looks": "drawable"},
    ps.Regions: {
        "bottom_skin": "bottom_solid_infill",
        "top_skin": "top_solid_infill",
        "solid": "solid_infill",
        "sparse": "internal_infill",
    },
    ps.Sections: {"turned": "inverted"},
    ps.Strategies: {"own_infill": "custom_infill", "own_flavour": "checked_flavour"},
    ps.Toolpaths: {
        "carried": "support_ratio",
        "sweep": "chain_id",
        "rise": "z_offset",
        "share": "flow_ratio",
        "rule": "settings_id",
        "ruled": "with_settings",
    },
    ps.Travels: {"n_ways": "n_travels"},
    ps.Verdict: {"account": "deposition", "looks": "drawable"},
    ps.Model: {"doubts": "size_warning"},
    ps.Job: {"looks": "drawable"},
    Coverage: {"hanging": "unsupported_length"},
    CoverageRules: {
        "skin": "surface_depth",
        "slit": "min_gap",
        "beyond": "outside_tolerance",
        "too_often": "overlap_ratio",
    },
    CoverageLimits: {"air": "unsupported", "under": "underfilled", "over": "overfilled"},
    Labels: {"item": "object_id"},
    Report: {
        "starvations": "underruns",
        "starved_seconds": "underrun_seconds",
        "starved": "underrun_list",
        "laid_min": "extrusion_min",
        "laid_max": "extrusion_max",
    },
    Deposition: {
        "mishaps": "defects",
        "laid": "first_extrusion",
        "lost": "first_missing",
        "drought": "missing_extrusion",
    },
    LayerDeposition: {
        "empty": "empty_length",
        "back": "retracted_length",
        "wrong": "first_empty",
        "middle": "median_section",
        "thick": "thick_section",
    },
}
FORMER_ROLES: Final = {
    "INNER_PERIMETER": "PERIMETER",
    "OUTER_PERIMETER": "EXTERNAL_PERIMETER",
    "BOTTOM_SKIN": "BOTTOM_SOLID_INFILL",
    "SPARSE": "INTERNAL_INFILL",
    "SOLID": "SOLID_INFILL",
    "TOP_SKIN": "TOP_SOLID_INFILL",
}
BOX: Final = box((2, 2, 1))
PLAN: Final = ps.LayerPlan.from_tops(np.array([0.5, 1.0]))


def expect_warning(old: str, new: str) -> Any:
    """Expect the warning about one former name."""
    return pytest.warns(FutureWarning, match=rf"{old}.* is now called .*{new}")


@pytest.mark.parametrize("kind", FORMER_FIELDS, ids=lambda kind: kind.__name__)
def test_former_attributes_work_with_a_warning(kind: type[Any]) -> None:
    for old, new in FORMER_FIELDS[kind].items():
        is_method = old in {"ruled", "doubts"}
        value = SimpleNamespace(**{new: (lambda: "value") if is_method else "value"})
        former = getattr_static(kind, old)
        with expect_warning(old, new):
            found = former.fget(value) if isinstance(former, property) else former(value)
            found = found() if callable(found) else found
        assert found == "value"


@pytest.mark.parametrize(("old", "new"), FORMER_ROLES.items())
def test_former_roles_work_with_a_warning(old: str, new: str) -> None:
    for get in (lambda: getattr(ps.Role, old), lambda: ps.Role[old]):
        with expect_warning(old, new):
            assert get() is ps.Role[new]

    assert old not in dir(ps.Role)
    assert old not in ps.Role.__members__


def test_unknown_names_are_still_errors() -> None:
    with pytest.raises(AttributeError, match="SKIN"):
        ps.Role.SKIN  # type: ignore[attr-defined] # noqa: B018 - a name that never was
    with pytest.raises(KeyError):
        ps.Role["SKIN"]
    with pytest.raises(AttributeError, match="'Quality' object has no attribute 'sparse'"):
        ps.load_profile().quality.sparse  # type: ignore[attr-defined] # noqa: B018 - only in speeds


@pytest.mark.parametrize(
    ("old", "new", "build"),
    [
        ("items", "objects", lambda: ps.Mesh(BOX.triangles, items=())),
        ("turned", "inverted", lambda: ps.Sections(PLAN, ps.Areas.empty(2), turned=None)),
        ("reads", "commands", lambda: dataclasses.replace(ps.FLAVOURS["marlin"], reads={})),
        ("under", "underfilled", lambda: CoverageLimits(under=0.5)),
        ("skin", "surface_depth", lambda: CoverageRules(skin=1.0)),
    ],
)
def test_former_fields_are_accepted_by_constructors(old: str, new: str, build: Callable[[], Any]) -> None:
    with expect_warning(old, new):
        build()


def test_replace_with_a_former_field_changes_it() -> None:
    empty = ps.Areas.empty(2)
    regions = ps.Regions(PLAN, empty, empty, empty, empty, empty, np.zeros(0))
    other = ps.Areas.empty(2)

    with expect_warning("sparse", "internal_infill"):
        assert dataclasses.replace(regions, sparse=other).internal_infill is other  # type: ignore[call-arg]


def test_former_arguments_of_functions_work() -> None:
    columns = {"xy": np.array([[0.0, 0], [1, 0]]), "size": np.array([2]), "layer": np.array([0])}
    with expect_warning("carried", "support_ratio"):
        paths = ps.Toolpaths.gathered(
            PLAN,
            **columns,  # type: ignore[arg-type]
            role=np.array([4]),
            width=np.array([0.4]),
            closed=False,
            carried=np.array([0.5, 0.5]),
        )
    assert paths.support_ratio.tolist() == [0.5, 0.5]

    job = dataclasses.replace(ps.slice(BOX), profile=None)
    with (
        expect_warning("front_end", "firmware"),
        pytest.raises(ps.PrinterSlicerError, match="the job has no profile"),
    ):
        ps.dry_run(job, front_end=None)  # type: ignore[call-arg]


def test_former_names_of_printing_work() -> None:
    controls: Any = ps.Controls()
    with expect_warning("wanted", "requested"):
        assert not controls.wanted.is_set()
    with expect_warning("wants_end", "has_end_request"):
        assert not controls.wants_end
    with expect_warning("wish", "command"), pytest.raises(ps.PrinterSlicerError, match="does not respond"):
        controls.ask(wish=commands.Status(), timeout=0)
    with expect_warning("printer_slicer.Done", "printer_slicer.PrintResult"):
        assert ps.Done is ps.PrintResult  # type: ignore[attr-defined]


def test_former_settings_of_a_profile_are_readable() -> None:
    quality: Any = ps.load_profile().quality
    with expect_warning("Speeds.sparse", "Speeds.internal_infill"):
        assert quality.speeds.sparse == quality.speeds.internal_infill
    with expect_warning("Quality.min_sparse_area", "Quality.solid_infill_below_area"):
        assert quality.min_sparse_area == quality.solid_infill_below_area


def test_current_names_give_no_warning() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dataclasses.replace(ps.slice_stages(BOX, ps.load_profile()).regions, bridge_angle=np.zeros(0))
