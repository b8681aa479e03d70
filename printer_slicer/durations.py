"""Durations in words."""

from __future__ import annotations

__all__ = ["spoken"]


def spoken(seconds: float) -> str:
    """A duration as `1d 2h 3m 4s`, without leading zeros."""
    total = round(seconds)
    parts = [(total // 86400, "d"), (total // 3600 % 24, "h"), (total // 60 % 60, "m"), (total % 60, "s")]
    while len(parts) > 1 and parts[0][0] == 0:
        parts.pop(0)
    return " ".join(f"{count}{unit}" for count, unit in parts)
