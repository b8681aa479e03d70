"""Find printers of a bundle by names as users type them: without the maker, the nozzle or hyphens."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from printer_slicer.name_search import rank_match, split_name

__all__ = ["find_printers"]


def find_printers(query: str, names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the printers that match a name best; empty if none matches.

    A nozzle in the name only decides between printers that match equally well without it.

    Args:
        query: the name as typed.
        names: printer -> its other names, such as that of its model.
    """
    found = _find_best_matches(query, names, with_nozzle=False)
    exact = _find_best_matches(query, {name: names[name] for name in found}, with_nozzle=True)
    return exact or found or _find_best_matches(query, names, with_nozzle=True)


def _find_best_matches(query: str, names: Mapping[str, Sequence[str]], *, with_nozzle: bool) -> list[str]:
    """Return the printers whose names match best; several if they match equally well."""
    asked = split_name(query, with_nozzle=with_nozzle)
    ranks = {}
    for printer, others in names.items():
        words = [split_name(one, with_nozzle=with_nozzle) for one in (printer, *others)]
        if found := [rank[0] for one in words if (rank := rank_match(asked, one))]:
            ranks[printer] = min(found)
    return [printer for printer, rank in ranks.items() if rank == min(ranks.values())]
