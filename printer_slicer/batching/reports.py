"""The report of a batch: a table as CSV, or a page with pictures that needs no server."""

from __future__ import annotations

import csv
import io
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, Final

from printer_slicer.batching.matrix import find_unbeaten_rows
from printer_slicer.batching.tasks import BatchResult
from printer_slicer.texts import format_duration, format_significant

__all__ = ["collect_row", "make_csv", "make_page", "mark_best_rows"]

_FORMULA: Final = frozenset("=+-@\t\r")
"""A spreadsheet takes text that begins with one of these as a formula."""

_FIGURES: Final = ("print time", "filament", "layers", "deviation", "volume error", "supports")


def collect_row(result: BatchResult) -> dict[str, Any]:
    """Return the figures of a result: sums over its plates, and the largest errors; None where it failed."""
    is_done = not result.problem
    supports = [one.facts["supports"] for one in result.files if one.facts["supports"]]
    return {
        "part": result.model,
        **result.choices,
        "status": "done" if is_done else "failed",
        "seconds": round(result.total("seconds"), 1) if is_done else None,
        "filament_g": round(result.total("filament_g"), 2) if is_done else None,
        "layers": int(result.total("layers")) if is_done else None,
        "max_error_mm": result.find_largest("max_error_mm") if is_done else None,
        "volume_error_mm3": round(
            sum(one.facts["certificate"]["volume_error_mm3"] for one in result.files), 2
        )
        if is_done
        else None,
        "support_g": round(sum(one["filament_g"] for one in supports), 2) if is_done else None,
        "files": " ".join(one.name for one in result.files),
        "warnings": "; ".join(result.warnings),
        "problem": result.problem,
        "slicing_seconds": result.seconds,
    }


def mark_best_rows(results: Sequence[BatchResult]) -> list[bool]:
    """Return for each result whether no other one of the same model has less time, error and volume error."""
    places: dict[str, list[int]] = {}
    for at, one in enumerate(results):
        if not one.problem:
            places.setdefault(one.model_sha256, []).append(at)
    best = [False] * len(results)
    for own in places.values():
        for at, is_best in zip(
            own, find_unbeaten_rows([collect_row(results[at]) for at in own]), strict=True
        ):
            best[at] = is_best
    return best


def make_csv(results: Sequence[BatchResult]) -> bytes:
    """Return the results as a table with a heading, in UTF-8."""
    rows = [collect_row(one) for one in results]
    names = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _make_plain(value) for name, value in row.items()} for row in rows)
    return text.getvalue().encode("utf-8", "replace")


def _make_plain(value: Any) -> Any:
    """Return a value that no spreadsheet takes as a formula."""
    return f"'{value}" if isinstance(value, str) and value[:1] in _FORMULA else value


def make_page(results: Sequence[BatchResult], title: str) -> bytes:
    """Return the results as a page with a table that can be sorted, and a picture of each part."""
    keys = list(dict.fromkeys(key for one in results for key in one.choices))
    heads = ["", "part", *keys, *_FIGURES, "findings"]
    head = "".join(f"<th scope=col>{_make_sort_button(text)}</th>" for text in heads)
    best = mark_best_rows(results) if keys else [False] * len(results)
    body = "\n".join(
        _format_row(one, keys, heads, is_best=mark) for one, mark in zip(results, best, strict=True)
    )
    failed = sum(bool(one.problem) for one in results)
    summary = f"{len(results) - failed} of {len(results)} sliced" + (f", {failed} failed" if failed else "")
    note = (
        "<p>Bold: no other row of this part has less print time, deviation and volume error.</p>"
        if keys
        else ""
    )
    template = files("printer_slicer.batching").joinpath("report.html").read_text("utf-8")
    values = {"title": escape(title), "summary": summary, "note": note, "head": head, "body": body}
    for name, value in values.items():
        template = template.replace(f"<!--{name}-->", value)
    return template.encode("utf-8", "replace")


def _make_sort_button(text: str) -> str:
    """Return the content of the head of a column."""
    return f"<button>{escape(text)}</button>" if text else ""


def _format_row(result: BatchResult, keys: Sequence[str], heads: Sequence[str], *, is_best: bool) -> str:
    """Return a row of the table; the cells have the values by which they are sorted, and the heads of their columns."""
    picture = b64encode(result.picture).decode()
    shown = f'<img src="data:image/png;base64,{picture}" alt="" width=80 height=60>' if picture else ""
    row = collect_row(result)
    texts = [("", shown), (result.model, f"<b>{escape(result.model)}</b><br>{escape(row['files'])}")]
    texts += [(value, escape(value)) for value in (result.choices.get(key, "") for key in keys)]
    if result.problem:
        cell = f'<td colspan=7 data-value="" data-head="failed" class=failed>{escape(result.problem)}</td>'
        return f"<tr>{_join_cells(texts, heads)}{cell}</tr>"
    texts += [(str(value), text) for value, text in _list_figures(row)]
    found = "<br>".join(escape(text) for text in result.warnings)
    texts.append((str(len(result.warnings)), found))
    return f"<tr{' class=best' if is_best else ''}>{_join_cells(texts, heads)}</tr>"


def _list_figures(row: Mapping[str, Any]) -> list[tuple[float, str]]:
    """Return (value, text) of the figures of a row."""
    support = row["support_g"]
    return [
        (row["seconds"], format_duration(row["seconds"])),
        (row["filament_g"], f"{format_significant(row['filament_g'])} g"),
        (row["layers"], str(row["layers"])),
        (row["max_error_mm"], f"{format_significant(row['max_error_mm'])} mm"),
        (row["volume_error_mm3"], f"{format_significant(row['volume_error_mm3'])} mm³"),
        (support, f"{format_significant(support)} g" if support else ""),
    ]


def _join_cells(texts: Sequence[tuple[str, str]], heads: Sequence[str]) -> str:
    """Return cells with values and content."""
    return "".join(
        f'<td data-value="{escape(value, quote=True)}" data-head="{escape(head, quote=True)}">{text}</td>'
        for (value, text), head in zip(texts, heads, strict=False)
    )
