"""Temperatures of the printers in the last 24 hours: fine for half an hour, and one sample a minute before."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from threading import Lock
from typing import Final

from printer_slicer.values import Struct

__all__ = ["TemperatureHistory", "TemperatureSample"]

_RECENT: Final = 1800.0  # s in which samples are fine
_LENGTH: Final = 86400.0  # s
_FINE_STEP, _COARSE_STEP = 2.0, 60.0  # s between samples


class TemperatureSample(Struct, frozen=True):
    """Temperatures at one time.

    Attributes:
        time: s since 1970.
        temperatures: actual and target temperature of each heater, °C.
    """

    time: float
    temperatures: dict[str, tuple[float, float]]


class TemperatureHistory:
    """Keeps the samples of all printers in memory."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._fine: dict[str, deque[TemperatureSample]] = {}
        self._coarse: dict[str, deque[TemperatureSample]] = {}

    def add(self, printer: str, temperatures: Mapping[str, Sequence[float]], time: float) -> None:
        """Add a sample, unless the last one of this printer is too new."""
        if not temperatures:
            return
        with self._lock:
            fine = self._fine.setdefault(printer, deque())
            coarse = self._coarse.setdefault(printer, deque())
            if fine and time - fine[-1].time < _FINE_STEP:
                return
            fine.append(TemperatureSample(time, {key: (one[0], one[1]) for key, one in temperatures.items()}))
            while time - fine[0].time > _RECENT:
                old = fine.popleft()
                if not coarse or old.time - coarse[-1].time >= _COARSE_STEP:
                    coarse.append(old)
            while coarse and time - coarse[0].time > _LENGTH:
                coarse.popleft()

    def list_samples(self, printer: str) -> tuple[TemperatureSample, ...]:
        """Return the samples of a printer, the oldest first."""
        with self._lock:
            return (*self._coarse.get(printer, ()), *self._fine.get(printer, ()))
