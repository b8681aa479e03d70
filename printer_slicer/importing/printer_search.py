"""Find printers of a bundle by a name as people type it: without maker, nozzle or hyphens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from printer_slicer.name_search import match_rank, name_words

__all__ = ["find_printers"]


def find_printers(wanted: str, names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the printers that match a name best; empty if none does.

    A nozzle in the name counts only between printers that match as well without it.

    Args:
        wanted: the name as typed.
        names: printer -> its other names, such as that of its model.
    """
    found = _best(wanted, names, with_nozzle=False)
    exact = _best(wanted, {name: names[name] for name in found}, with_nozzle=True)
    return exact or found or _best(wanted, names, with_nozzle=True)


def _best(wanted: str, names: Mapping[str, Sequence[str]], *, with_nozzle: bool) -> list[str]:
    """Return the printers that match equally well and best."""
    asked = name_words(wanted, with_nozzle=with_nozzle)
    ranks = {}
    for printer, others in names.items():
        words = [name_words(one, with_nozzle=with_nozzle) for one in (printer, *others)]
        if found := [rank[0] for one in words if (rank := match_rank(asked, one))]:
            ranks[printer] = min(found)
    return [printer for printer, rank in ranks.items() if rank == min(ranks.values())]
