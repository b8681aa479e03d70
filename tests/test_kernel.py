"""The compiled kernel gives the results of the Python code; without it, everything works, and the reason is said."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import UsageError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.medial_axis import MedialAxis, medial_axis
from printer_slicer.geometry.voronoi_diagram import Diagram, compute_diagrams
from printer_slicer.kernel import VARIABLE, describe_kernel, load_kernel
from printer_slicer.model import Mesh
from printer_slicer.perimeters.facing_sides import find_facing_sides
from printer_slicer.perimeters.layout import _find_nearest_changes
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import Profile
from tests.contoured_parts import dome
from tests.kernels import KERNEL, SAME_BITS, needs_kernel
from tests.parts import box_with_hole, case_study, cone, plain, prism
from tests.strategies import box, clean_areas, rectilinear_areas
from tests.supports.shapes import mushroom
from tests.waiting import LAST_RESORT

same_bits = pytest.mark.skipif(not SAME_BITS, reason="pyvoronoi may round otherwise on this processor")


def differences(one: Boxes | Diagram | MedialAxis, other: Boxes | Diagram | MedialAxis) -> list[str]:
    """Names of the arrays of which not every bit is equal."""
    names = type(one).__annotations__
    pairs = {name: (getattr(one, name), getattr(other, name)) for name in names}
    return [name for name, (a, b) in pairs.items() if a.dtype != b.dtype or a.tobytes() != b.tobytes()]


def axis_with(kernel: str, areas: Areas) -> MedialAxis:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return medial_axis(areas, 4.0)


def diagrams_with(kernel: str, steps: np.ndarray, areas: np.ndarray) -> Diagram:
    """Diagrams of sides (S, 2, 2) in steps of the grid."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return compute_diagrams(steps / 100_000, areas)


def facing_with(kernel: str, areas: Areas, distance: list[float]) -> Boxes:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return find_facing_sides(areas, np.array(distance), np.deg2rad(26))


def sliced_with(kernel: str, part: Mesh, wanted: Profile) -> bytes:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return gcode_of(slice_part(part, wanted), wanted)


def narrow_strips(rng: np.random.Generator, n_areas: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Sides of strips along straight and bent lines: most sides are nearly parallel to another one."""
    x = np.sort(rng.choice(size, 9, replace=False))
    y = rng.integers(-size // 50, size // 50, (n_areas, len(x)))
    wide = rng.integers(2, size // 10, (n_areas, 1))
    low, high = (np.stack(np.broadcast_arrays(x, y + side), axis=2) for side in (0 * wide, wide))
    rings = np.concatenate([low, high[:, ::-1]], axis=1)
    sides = np.stack([rings, np.roll(rings, -1, axis=1)], axis=2)
    return sides.reshape(-1, 2, 2), np.repeat(np.arange(n_areas), sides.shape[1])


# Whether it is there


def test_the_compiled_kernel_is_there() -> None:
    """Skipped, with the reason, where it is not: then all tests run with the Python code."""
    if KERNEL != "yes":
        pytest.skip(f"compiled kernel: {KERNEL}")

    assert load_kernel() is not None or describe_kernel() == f"no ({VARIABLE} is off)"


def test_the_kernel_can_be_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "off")

    assert load_kernel() is None
    assert describe_kernel() == f"no ({VARIABLE} is off)"


@needs_kernel
def test_a_kernel_that_is_required_is_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")

    assert describe_kernel() == "yes"


@pytest.mark.skipif(KERNEL == "yes", reason="there is a compiled kernel")
def test_a_kernel_that_is_required_but_missing_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")

    with pytest.raises(UsageError, match="there is no compiled kernel"):
        load_kernel()


def test_other_values_of_the_variable_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "yes")

    with pytest.raises(UsageError, match="unknown value 'yes' of PRINTER_SLICER_KERNEL"):
        load_kernel()


# Same results


@needs_kernel
@same_bits
@given(clean_areas(2))
def test_medial_axes_are_the_same_to_the_last_bit(areas: Areas) -> None:
    assert differences(axis_with("off", areas), axis_with("required", areas)) == []


@needs_kernel
@same_bits
@given(rectilinear_areas(2))
def test_medial_axes_of_right_angles_are_the_same_to_the_last_bit(areas: Areas) -> None:
    assert differences(axis_with("off", areas), axis_with("required", areas)) == []


@needs_kernel
@given(clean_areas(2) | rectilinear_areas(2), st.floats(0.1, 3), st.floats(0.1, 3))
def test_facing_sides_are_the_same(areas: Areas, one: float, other: float) -> None:
    assert differences(*(facing_with(kernel, areas, [one, other]) for kernel in ("off", "required"))) == []


@needs_kernel
@pytest.mark.parametrize("distance", [0.5, 0.9, 1.2])
def test_facing_sides_of_narrow_strips_are_the_same(distance: float) -> None:
    """Three strips from 0.3 to 1.2 mm wide with bends, and a hole beside a straight side."""
    rng = np.random.default_rng(3)
    x = np.linspace(0, 20, 40)
    rings = []
    for k, width in enumerate([0.3, 0.8, 1.2]):
        low = np.column_stack([x, 5 * k + rng.normal(0, 0.05, len(x))])
        rings.append(np.concatenate([low, np.add(low, [0, width])[::-1]]))
    areas = Areas.from_rings([rings, [box(0, 0, 9, 9), box(4, 0.6, 8, 8)[::-1]]])
    found = [facing_with(kernel, areas, [distance] * 2) for kernel in ("off", "required")]

    assert len(found[0].layer) > 3
    assert differences(*found) == []


@needs_kernel
@given(
    st.lists(
        st.tuples(st.integers(0, 9), st.integers(0, 9), st.sampled_from([0.0, 0.1, 0.2, 0.25, 0.9, np.inf])),
        max_size=30,
    ),
    st.sets(st.integers(0, 9)),
    st.sampled_from([0.3, 0.5, 2.0]),
)
def test_nearest_changes_are_the_same(
    links: list[tuple[int, int, float]], marked: set[int], reach: float
) -> None:
    """Also of ways of equal length."""
    port = np.array([(a, b) for a, b, _ in links], np.int64).reshape(-1, 2)
    length = np.array([length for _, _, length in links])
    changing = np.isin(np.arange(10), list(marked))
    found = []
    for kernel in ("off", "required"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            found.append(_find_nearest_changes(port, length, changing, reach))

    assert [array.tolist() for array in found[0]] == [array.tolist() for array in found[1]]


@needs_kernel
@same_bits
@pytest.mark.parametrize("size", [2**10, 10**5, 2**21])
def test_diagrams_of_nearly_parallel_sides_are_the_same_to_the_last_bit(size: int) -> None:
    """Doubles do not decide these: integers of several hundred bits do."""
    steps, areas = narrow_strips(np.random.default_rng(size), 60, size)

    assert differences(*(diagrams_with(kernel, steps, areas) for kernel in ("off", "required"))) == []


@needs_kernel
@same_bits
@pytest.mark.parametrize(
    "part",
    [
        box_with_hole((12.0, 12.0, 2.0), (11.0, 10.4)),
        case_study(),
        prism([(0.0, 0.0), (14.0, 0.0), (14.0, 0.5), (3.0, 1.9)], 1.0),
    ],
    ids=["thin walls", "case study", "wedge"],
)
def test_gcode_is_the_same_to_the_last_byte(part: Mesh) -> None:
    wanted = plain()
    expected = sliced_with("off", part, wanted)

    assert sliced_with("required", part, wanted) == expected
    assert sliced_with("off", part, plain(varying_walls=False)) != expected  # it has narrow places


@needs_kernel
@same_bits
@pytest.mark.parametrize(
    "changes",
    [
        {"support": "columns"},
        {"support": "tree"},
        {"support": "auto", "raft_height": 0.8, "planner__kind": "area"},
        {"arc_tolerance": 0.02, "infill": "gyroid"},
        {"single_top_perimeter": True, "extra_perimeters": True, "perimeters": 3},
    ],
    ids=", ".join,
)
def test_gcode_with_these_settings_is_the_same_to_the_last_byte(changes: dict[str, object]) -> None:
    part = mushroom(cap=6.0, height=3.0)

    found = [sliced_with(kernel, part, plain(**changes)) for kernel in ("off", "required")]

    assert found[0] == found[1]
    assert found[0] != sliced_with("required", part, plain())  # the settings change something


@needs_kernel
@same_bits
def test_gcode_of_a_vase_is_the_same_to_the_last_byte() -> None:
    part, wanted = cone(6.0, 4.0), plain(spiral=True)

    assert sliced_with("off", part, wanted) == sliced_with("required", part, wanted)


@needs_kernel
@same_bits
def test_gcode_of_contoured_tops_is_the_same_to_the_last_byte() -> None:
    part, wanted = dome(8.0, 2.0, 24), plain(z_contouring=True)

    found = [sliced_with(kernel, part, wanted) for kernel in ("off", "required")]

    assert found[0] == found[1]
    assert found[0] != sliced_with("required", part, plain())


# Errors


@needs_kernel
@pytest.mark.parametrize(
    ("sides", "counts", "message"),
    [
        (np.zeros((2, 4), np.int64), [1], "numbers of sides"),
        (np.zeros((2, 4), np.int64), [3], "numbers of sides"),
        (np.zeros((2, 4), np.int64), [2, 0], "numbers of sides"),
        (np.zeros((2, 4), np.int64), [3, -1], "numbers of sides"),
        (np.zeros((1, 4), np.int64), [2**62, 2**62], "numbers of sides"),
        (np.zeros(7, np.int64), [1], "numbers of sides"),
        (np.zeros(33, np.int8), [1], "numbers of sides"),
        (np.full((1, 4), 2**31, np.int64), [1], "more than 32 bits"),
        (np.array([[4, 2, 4, 7], [8, 9, 7, 4], [7, 7, 1, 6]], np.int64), [3], "sides cross"),
    ],
)
def test_wrong_input_is_an_error(
    sides: np.ndarray, counts: list[int], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match=message):
        kernel.voronoi_diagrams(sides.data, np.array(counts, np.int64).data)


@needs_kernel
def test_sides_without_all_their_numbers_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    assert kernel.facing_boxes(np.zeros((0, 11)).data, 0.9) == b""
    with pytest.raises(ValueError, match="11 numbers"):
        kernel.facing_boxes(np.zeros((2, 8)).data, 0.9)


@needs_kernel
@pytest.mark.parametrize(
    ("sides", "cells", "ends", "message"),
    [
        (7, [[0, 1], [0, 3]], 8, "do not match"),
        (8, [[0, 1]], 4, "do not match"),
        (8, [[0, 1], [0, 3]], 4, "do not match"),
        (8, [[0, 1], [1, 3]], 8, "does not exist"),
        (8, [[-1, 1], [0, 3]], 8, "does not exist"),
    ],
)
def test_edges_that_do_not_match_the_sides_are_an_error(
    sides: int, cells: list[list[int]], ends: int, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match=message):
        kernel.inner_edges(np.zeros(sides).data, np.array(cells).data, np.zeros(ends).data, 1.0)


@needs_kernel
@pytest.mark.parametrize(
    ("links", "lengths", "message"),
    [
        ([[0, 1], [1, 2]], [1.0], "do not match"),
        ([[0, 3]], [1.0], "does not exist"),
        ([[-1, 2]], [1.0], "does not exist"),
        ([[0, 1]], [-1.0], "negative"),
    ],
)
def test_wrong_links_are_an_error(
    links: list[list[int]], lengths: list[float], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match=message):
        kernel.nearest_marked(np.array(links).data, np.array(lengths).data, np.ones(3, np.int64).data, 9.0)


@needs_kernel
@pytest.mark.parametrize(
    ("n_numbers", "bins", "start", "listed", "message"),
    [
        (9, [0, 0], [0, 1], [0], "shape"),
        (10, [0, 1], [0, 1], [0], "point is in a bin"),
        (10, [-2, 0], [0, 1], [0], "point is in a bin"),
        (10, [0, 0], [0, 1], [1], "bin has a facet"),
        (10, [0, 0], [0, 2], [0], "beyond the list"),
        (10, [0, 0], [1, 0], [0], "ascend"),
    ],
)
def test_bins_that_do_not_match_their_facets_are_an_error(
    n_numbers: int,
    bins: list[int],
    start: list[int],
    listed: list[int],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match=message):
        kernel.highest_facets(
            np.zeros(n_numbers), np.array(bins), np.array(start), np.array(listed), np.zeros(13)
        )


@needs_kernel
def test_sides_that_cross_do_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    """In another process, because what goes wrong here would end it."""
    monkeypatch.setenv(VARIABLE, "required")
    code = (
        "import numpy as np\nfrom printer_slicer.kernel import load_kernel\nkernel = load_kernel()\n"
        "rng = np.random.default_rng(1)\n"
        "for span in [2, 5, 50, 10_000, 2**31 - 1] * 400:\n"
        "    sides = rng.integers(-span, span, (rng.integers(1, 12), 4), endpoint=True, dtype=np.int64)\n"
        "    try:\n        kernel.voronoi_diagrams(sides.data, np.array([len(sides)], np.int64).data)\n"
        "    except ValueError:\n        pass\n"
        "print('done')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=LAST_RESORT, check=False
    )

    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")
