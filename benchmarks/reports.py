"""Print the tables of the planning benchmark, and whether its targets are met."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from statistics import median
from typing import Final

from benchmarks.curves import Frontier, Minutes, Row
from benchmarks.match import Match
from benchmarks.sweeps import OPTIMAL, USUAL

__all__ = ["BASES", "judgement", "match_table", "part_table", "plan_table", "ratio_table"]

BASES: Final[tuple[tuple[str, Minutes], ...]] = (
    ("our toolpaths for every plan", lambda row: row.score.minutes),
    ("PrusaSlicer's toolpaths for every plan", lambda row: row.prusa_minutes),
    ("each slicer's own G-code", lambda row: row.own_minutes),
)
"""Ways to count minutes."""

_DEVIATION, _MINUTES = 0.75, 0.8
"""Targets against the best peer: ratio of deviations in equal minutes, or ratio of minutes for equal deviation."""

_LAYERS: Final = {"PrusaSlicer adaptive": 0.95, "Cura adaptive": 0.90}
"""Targets at the peer's own errors: ratio of layers, median over the parts; never more than 1."""

_WHOLE: Final = 1e-9


def plan_table(rows: Sequence[Row]) -> str:
    """Return all figures of every plan. Distances are in µm, volumes in mm³."""
    heads = ["planner", "setting", "layers", "min", "own min", "Prusa min", "mean", "p95", "max", "bound"]
    heads += ["volume", "worst flat", "top", "CPU s"]
    return _table(heads, [_cells(row) for row in rows], 2)


def _cells(row: Row) -> list[str]:
    score = row.score
    lengths = (score.mean, score.p95, score.max, score.bound)
    return [
        row.family,
        row.setting,
        str(score.layers),
        f"{score.minutes:.1f}",
        "=" if row.ours else f"{row.own_minutes:.1f}",
        _number(row.prusa_minutes, ".1f"),
        f"{1e3 * lengths[0]:.2f}",
        *(f"{1e3 * length:.1f}" for length in lengths[1:]),
        f"{score.volume:.2f}",
        f"{1e3 * score.worst_flat:.1f}",
        f"{1e3 * score.top_error:+.1f}",
        _number(row.cpu, ".2f"),
    ]


def ratio_table(rows: Sequence[Row], minutes: Minutes) -> str:
    """Compare our curve with each plan of the peers. A star marks plans that no other peer's plan beats.

    The result is empty if there are no such minutes of ours or of a peer.
    """
    lines: list[list[str]] = []
    if not any(row.ours and minutes(row) is not None for row in rows):
        return ""
    for row, best, deviation, time in _ratios(rows, minutes):
        name = f"{row.family}{' *' if best else ''}"
        own = minutes(row) or 0.0
        lines.append(
            [
                name,
                row.setting,
                f"{own:.1f}",
                f"{1e3 * row.score.mean:.2f}",
                _number(deviation),
                _number(time),
            ]
        )
    heads = [
        "peer",
        "setting",
        "min",
        "mean µm",
        "our deviation in its minutes",
        "our minutes for its deviation",
    ]
    return _table(heads, lines, 2) if lines else ""


def _ratios(rows: Sequence[Row], minutes: Minutes) -> Iterator[tuple[Row, bool, float | None, float | None]]:
    """Return for each plan of a peer: whether it is among the best, and our deviation and minutes divided by its."""
    ours = Frontier([row for row in rows if row.ours and row.family in OPTIMAL], minutes)
    theirs = [row for row in rows if not row.ours and minutes(row) is not None]
    for row in theirs:
        own = minutes(row) or 0.0
        best = not any(
            (minutes(other) or 0.0) <= own and other.score.mean < row.score.mean for other in theirs
        )
        mean, time = ours.mean_at(own), ours.minutes_at(row.score.mean)
        deviation = None if mean is None or row.score.mean < _WHOLE else mean / row.score.mean
        yield row, best, deviation, None if time is None else time / own


def match_table(matches: Sequence[Match]) -> str:
    """Return the fewest layers with no larger error and volume error than a peer's plan."""
    lines = []
    for one in matches:
        layers = one.our_layers / one.layers - 1 if one.our_layers else None
        time = one.our_minutes / one.minutes - 1 if one.our_minutes else None
        terms = [one.family, one.setting, f"{1e3 * one.bound:.1f}", f"{one.volume:.2f}", str(one.layers)]
        shares = [_number(layers, "+.1%"), _number(one.volume_ratio), _number(time, "+.1%")]
        lines.append([*terms, str(one.our_layers or "none"), *shares])
    heads = [
        "peer",
        "setting",
        "bound µm",
        "volume mm³",
        "layers",
        "our layers",
        "",
        "volume, equal layers",
        "minutes",
    ]
    return _table(heads, lines, 2)


def part_table(parts: Sequence[tuple[str, Sequence[Row], Sequence[Match]]]) -> str:
    """Return for each part the range of deviation, minutes and layers: ours divided by the peers' adaptive plans.

    Args:
        parts: name, plans and matches of each.
    """
    lines = []
    for name, rows, matches in parts:
        cells = [name]
        for family in _LAYERS:
            found = [(d, t) for row, _, d, t in _ratios(rows, BASES[0][1]) if row.family == family]
            layers = [
                one.our_layers / one.layers for one in matches if one.family == family and one.our_layers
            ]
            cells += [_range([d for d, _ in found]), _range([t for _, t in found]), _range(layers)]
        lines.append(cells)
    heads = [f"{family}: {what}" for family in _LAYERS for what in ("deviation", "minutes", "layers")]
    return _table(["part", *heads], lines, 1)


def _range(values: Sequence[float | None]) -> str:
    known = sorted(value for value in values if value is not None)
    if not known:
        return "-"
    return f"{known[0]:.2f}" if known[-1] - known[0] < 0.005 else f"{known[0]:.2f}..{known[-1]:.2f}"


def judgement(parts: Sequence[tuple[Sequence[Row], Sequence[Match]]]) -> str:
    """Return a line for every target and the result over all parts."""
    lines = []
    for name, minutes in BASES:
        found = [
            (deviation, time)
            for rows, _ in parts
            for _, best, deviation, time in _ratios(rows, minutes)
            if best and (deviation is not None or time is not None)
        ]
        if found:
            met = sum(
                (d is not None and d <= _DEVIATION) or (t is not None and t <= _MINUTES) for d, t in found
            )
            worst = max((d for d, _ in found if d is not None), default=0.0)
            lines.append(
                f"{name}: for {met} of {len(found)} best plans of peers, ours needs at most {_DEVIATION:g} of the "
                f"deviation or {_MINUTES:g} of the minutes; largest ratio of deviations {worst:.3f}"
            )
    return "\n".join([*lines, *_layer_lines([one for _, some in parts for one in some])])


def _layer_lines(matches: Sequence[Match]) -> Iterator[str]:
    """Return whether our plans need fewer layers at the errors of the peers' own adaptive plans."""
    for family, target in _LAYERS.items():
        known = [
            (one, (one.our_layers or 2 * one.layers) / one.layers) for one in matches if one.family == family
        ]
        usual = [share for one, share in known if one.setting == USUAL[family]]
        if usual:
            most = max(share for _, share in known)
            met = "met" if median(usual) <= target and most <= 1 else "MISSED"
            yield (
                f"layers at the errors of {family}: median ratio {median(usual):.3f} for its usual settings "
                f"(target {target:g}), largest ratio {most:.3f} for {len(known)} plans (target 1): {met}"
            )


def _number(value: float | None, form: str = ".3f") -> str:
    return "-" if value is None else f"{value:{form}}"


def _table(heads: Sequence[str], lines: Sequence[Sequence[str]], n_words: int) -> str:
    """Return a table whose first columns are text and whose other columns are numbers."""
    rule = "|" + "---|" * n_words + "---:|" * (len(heads) - n_words)
    rows = ["| " + " | ".join(line) + " |" for line in [heads, *lines]]
    return "\n".join([rows[0], rule, *rows[1:]])
