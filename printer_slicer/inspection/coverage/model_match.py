"""Find where a part is in a G-code file, its layers there, and its sections in these layers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, difference
from printer_slicer.inspection.coverage.contoured_sections import add_contoured_slopes
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.matching import (
    Match,
    find_external_perimeters,
    fit_sections,
    guess_shift,
    shift_areas,
)
from printer_slicer.inspection.coverage.object_layers import (
    OwnPart,
    has_own_layers,
    has_thick_perimeters,
    separate_features,
    separate_objects,
    stack_groups,
)
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.inspection.coverage.zones import footprint
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.placing import Placement
from printer_slicer.slicing import cut
from printer_slicer.values import Struct, replace

__all__ = ["MIN_MATCH_SHARE", "RESOLUTION", "MatchedPart", "match_part"]

RESOLUTION: Final = 0.005
"""Maximum deviation of sections from the mesh, mm; sections for measurements are finer than printed ones."""
MIN_MATCH_SHARE: Final = 0.5
"""Share of the external perimeter length that must fit; less means that the file prints another part."""
_CUT_OFFSET: Final = 0.002  # mm from the middle of a layer; flat surfaces here may be rounded up or down
_MIN_DIFFERENCE: Final = 1.0  # mm² between the sections above and below a flat surface
_NEAR_DISTANCE: Final = 3.0  # mm around the part; extrusions farther away make no layers
_GOOD_SHARE: Final = 0.9  # of the external perimeter length; if so much fits, no other layers are tried


class MatchedPart(Struct, frozen=True, eq=False):
    """A part at its position in a file.

    Attributes:
        parts: the part; if objects or features have layers of their own, the parts whose layers are the groups of the
            stack.
        stack: its layers, which may be fewer than those of the file.
        sections: a section for each layer of the stack.
        match: shift from the position of the mesh, and the quality of the fit.
    """

    parts: tuple[Mesh, ...]
    stack: Stack
    sections: Areas
    match: Match

    @property
    def bounds(self) -> Float:
        """Lowest and highest corner (2, 3) of the part, mm."""
        low, high = np.array([part.bounds for part in self.parts]).swapaxes(0, 1)
        return np.array([low.min(axis=0), high.max(axis=0)])


def match_part(
    mesh: Mesh, beads: Extrusions, stack: Stack, placement: Placement | None = None
) -> MatchedPart:
    """Place a part at its position in a file.

    Args:
        mesh: the part, repaired, scaled and rotated, at any position.
        beads: extrusions of the file.
        stack: layers of the file.
        placement: position of the part; None searches for it.

    Raises:
        PartError: the part cannot be cut.
    """
    part, is_searched = _place_part(mesh, stack, placement), placement is None
    parts = separate_objects(part)
    if len(parts) == 1 and has_thick_perimeters(beads, stack):
        parts = separate_features(part, stack.top)
    own = None if len(parts) < 2 or stack.is_spiral else _match_own_layers(parts, beads, stack, is_searched)
    if own is not None and own.match.share >= _GOOD_SHARE:
        matched = own
    else:
        matched = _match_common_layers(part, beads, stack, is_searched)
        if own is not None and own.match.share > matched.match.share:
            matched = own
    x, y = (matched.bounds[0] - mesh.bounds[0])[:2].tolist()
    return replace(matched, match=replace(matched.match, shift=(x, y)))


def _match_common_layers(part: Mesh, beads: Extrusions, stack: Stack, is_searched: bool) -> MatchedPart:
    """Find the position of a part whose objects all have the layers of the file."""
    pair = _cut_below_and_above_middle([part], stack)
    match = _fit_position(stack, pair[0], is_searched=is_searched)
    part = part.moved((*match.shift, 0.0))
    near = _find_extrusions_near([part], beads)
    new_stack = stack_extrusions(beads, near)
    is_same_part = match.share >= MIN_MATCH_SHARE  # of another part, all layers count
    if is_same_part and near.any() and not np.array_equal(new_stack.top, stack.top):
        # Extrusions beside the part, such as a priming line, caused extra layers.
        stack, pair = new_stack, _cut_below_and_above_middle([part], new_stack)
    else:
        pair = (shift_areas(pair[0], match.shift), shift_areas(pair[1], match.shift))
    sections = add_contoured_slopes([part], stack, _choose_sections(stack, *pair))
    return MatchedPart((part,), stack, sections, match)


def _match_own_layers(
    parts: Sequence[OwnPart], beads: Extrusions, common: Stack, is_searched: bool
) -> MatchedPart | None:
    """Find the position of parts that have layers of their own; None if they have the common layers of the file.

    `common` are these layers.
    """
    if is_searched:
        shift = _guess_shift_of_box([part.mesh for part in parts], beads)
        parts = [part.moved(shift) for part in parts]
    stack = stack_groups(beads, parts, common)
    if not has_own_layers(stack, common):
        return None
    sections = _cut_parts([part.mesh for part in parts], stack, -_CUT_OFFSET)
    match = _fit_position(stack, sections, is_searched=is_searched)
    parts = [part.moved(match.shift) for part in parts]
    meshes = [part.mesh for part in parts]
    near = _find_extrusions_near(meshes, beads)
    stack = stack_groups(beads, parts, common, near if near.any() else None)
    pair = _cut_below_and_above_middle(meshes, stack)
    match = _fit_position(stack, pair[0], is_searched=is_searched)
    sections = _choose_sections(stack, *(shift_areas(one, match.shift) for one in pair))
    meshes = [part.moved(match.shift).mesh for part in parts]
    return MatchedPart(tuple(meshes), stack, add_contoured_slopes(meshes, stack, sections), match)


def _guess_shift_of_box(parts: Sequence[Mesh], beads: Extrusions) -> tuple[float, float]:
    """Return the shift from the middle of all parts to the middle of the external perimeters, mm."""
    outer = find_external_perimeters(beads)
    if not outer.any():
        return 0.0, 0.0
    ends = np.concatenate([beads.begin[outer], beads.end[outer]])
    corners = np.concatenate([part.bounds[:, :2] for part in parts])
    middles = [(points.min(axis=0) + points.max(axis=0)) / 2 for points in (ends, corners)]
    x, y = (middles[0] - middles[1]).tolist()
    return x, y


def _place_part(mesh: Mesh, stack: Stack, placement: Placement | None) -> Mesh:
    """Move the part to the requested position; by default, to the origin, on the raft or bed."""
    low, high = mesh.bounds
    shift = -low
    if placement is not None and placement.as_placed:
        shift[:2] = 0.0
    elif placement is not None and placement.center is not None:
        shift[:2] = np.asarray(placement.center) - (low + high)[:2] / 2
    if placement is not None and not placement.drop:
        shift[2] = 0.0
    else:
        shift[2] += stack.bottom[0]
    return mesh.moved(shift)


def _cut_below_and_above_middle(parts: Sequence[Mesh], stack: Stack) -> tuple[Areas, Areas]:
    """Return the sections just below the middle of each layer, and the sections just above it."""
    return _cut_parts(parts, stack, -_CUT_OFFSET), _cut_parts(parts, stack, _CUT_OFFSET)


def _cut_parts(parts: Sequence[Mesh], stack: Stack, above_middle: float) -> Areas:
    """Return the sections of parts in the layers of their groups, at a height above the middle of each layer, mm."""
    z, sections = (stack.top + stack.bottom) / 2 + above_middle, list[Areas]()
    for own in stack.layers_of_groups():
        part = parts[int(stack.group[own[0]])]
        areas = cut(part, LayerPlan(stack.top[own], z[own]), RESOLUTION).solid
        sections.append(areas.on_layers(own, stack.n_layers))
    return Areas.merged(sections)


def _fit_position(stack: Stack, sections: Areas, *, is_searched: bool) -> Match:
    """Find the position where sections fit, or measure how well they fit at the given position."""
    if not is_searched:
        return replace(fit_sections(stack, sections, rounds=0), shift=(0.0, 0.0))
    guess = guess_shift(stack, sections)
    match = fit_sections(stack, shift_areas(sections, guess))
    return replace(match, shift=(guess[0] + match.shift[0], guess[1] + match.shift[1]))


def _find_extrusions_near(parts: Sequence[Mesh], beads: Extrusions) -> Bool:
    """Return a mask (B,) of extrusions with a part's role that start near the bounding box of a mesh."""
    near = np.zeros(beads.n_beads, np.bool_)
    for part in parts:
        low, high = part.bounds[:, :2]
        near |= ((beads.begin > low - _NEAR_DISTANCE) & (beads.begin < high + _NEAR_DISTANCE)).all(axis=1)
    return np.asarray(near) & ~np.isin(beads.purpose, NOT_PART)


def _choose_sections(stack: Stack, low: Areas, high: Areas) -> Areas:
    """Choose for each layer the section below or above its middle that is more similar to the print.

    A flat surface exactly in the middle of a layer may be printed either way.
    """
    is_ambiguous = difference(low, high).area() + difference(high, low).area() > _MIN_DIFFERENCE
    if not is_ambiguous.any():
        return low
    chosen = is_ambiguous[stack.layer] & (stack.layer >= 0)
    chosen &= ~np.isin(stack.beads.purpose, NOT_PART)
    printed = footprint(stack, chosen)
    differences = [difference(one, printed).area() + difference(printed, one).area() for one in (low, high)]
    upper = is_ambiguous & (differences[1] < differences[0])
    return low.of_layers(~upper).merge(high.of_layers(upper))
