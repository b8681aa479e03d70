"""Objects with settings of their own: each is cut by itself at the planes of one plan, where no other is already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from printer_slicer.errors import UsageError
from printer_slicer.geometry import Areas, difference, union
from printer_slicer.model import Item, Mesh, Sections
from printer_slicer.profile import Profile
from printer_slicer.profile.places import for_object, objects_of

__all__ = ["apart", "side_by_side", "things_of"]


def things_of(part: Mesh, profile: Profile) -> list[tuple[Mesh, Profile]]:
    """What is sliced with the same settings, and these; all of the part where no object has any of its own.

    Objects are named as in their file, or, where several have one name, with a number: `lid_2`; the only one also as
    the part.

    Raises:
        UsageError: no object has that name, or which facets are whose is not known any more.
    """
    named = objects_of(profile)
    if not named:
        return [(part, profile)]
    called = _called([item.name for item in part.items] or [part.name])
    if len(called) == 1:
        called = [called[0] | {part.name}]
    _refuse_unknown(named, called)
    if len(called) == 1:
        return [(part, for_object(profile, called[0]))]
    if not all(item.count for item in part.items):
        raise UsageError(
            f"{part.name}: needs repair, after which it is not known what belongs to which object",
            remedy="mend the models, or leave out the settings of objects",
        )
    own: dict[tuple[str, ...], list[Item]] = {}
    for item, names in zip(part.items, called, strict=True):
        own.setdefault(tuple(name for name in named if name in names), []).append(item)
    return [(_only(part, items), for_object(profile, names)) for names, items in own.items()]


def _called(names: Sequence[str]) -> list[set[str]]:
    """All that each object may be called."""
    count: dict[str, int] = {}
    called = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        called.append({name, f"{name}_{count[name]}"} if names.count(name) > 1 else {name})
    return called


def _refuse_unknown(named: Sequence[str], called: Sequence[set[str]]) -> None:
    known = sorted(set().union(*called))
    for name in named:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise UsageError(
                f"settings for the object {name!r}, which there is not",
                remedy=f"{hint}there are: {', '.join(known)}",
            )


def _only(part: Mesh, items: Sequence[Item]) -> Mesh:
    """Some of the objects as a mesh of their own."""
    pieces = [part.triangles[item.first : item.first + item.count] for item in items]
    return Mesh(np.concatenate(pieces), ", ".join(item.name for item in items))


def apart(sections: Sequence[Sections]) -> list[Sections]:
    """The same without what an earlier one of them has already: what overlaps belongs to the first."""
    result, taken = [], Areas.empty(sections[0].plan.n_layers)
    for one in sections:
        free = difference(one.solid, taken) if taken.n_rings else one.solid
        result.append(replace(one, solid=free))
        taken = union(taken, one.solid) if taken.n_rings else one.solid
    return result


def side_by_side(sections: Sequence[Sections]) -> Sections:
    """The sections of all objects together."""
    if len(sections) == 1:
        return sections[0]
    gaps = sorted((gap for one in sections for gap in one.gaps), key=lambda gap: -gap.width)
    turned = [one.turned for one in sections if one.turned is not None]
    solid = sections[0].solid
    for one in sections[1:]:
        solid = union(solid, one.solid)
    return Sections(
        sections[0].plan,
        solid,
        sum(one.open_edges for one in sections),
        tuple(gaps),
        Areas.merged(turned) if turned else None,
    )
