"""Published process settings of ten machines, from their makers and PrusaSlicer's bundles, for layers of 0.2 mm in PLA.

These figures are deliberately independent of the shipped printers, which are compared with them. Flow, layer time and
minimum speed are those of the standard PLA of the same source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

__all__ = ["MACHINES", "Vendor"]


@dataclass(frozen=True, slots=True)
class Vendor:
    """The published process of one machine; speeds in mm/s, accelerations in mm/s².

    Attributes:
        source: profile and vendor.
        speeds: outer, inner, sparse, solid, top, gap, bridge, small, travel, first layer, its infill.
        accelerations: default, outer, inner, sparse, solid, top, bridge, first layer, travel.
        flow: mm³/s.
        layer_time: minimum layer time, s.
        slowest: minimum speed of layers that are slowed down.
        before: former greatest speed and acceleration of the shipped printer.
    """

    source: str
    speeds: tuple[float, ...]
    accelerations: tuple[float, ...]
    flow: float
    layer_time: float
    slowest: float
    before: tuple[float, float]


_PRUSA: Final = "PrusaResearch 2.5.5"
MACHINES: Final[Mapping[str, Vendor]] = {
    "creality_ender3": Vendor(
        "0.20 mm NORMAL (0.4 mm nozzle) @CREALITY, Creality 1.1.0",
        (25, 40, 50, 40, 30, 30, 25, 25, 150, 20, 20),
        (500, 500, 500, 500, 500, 500, 500, 500, 500),
        *(12, 20, 10),
        (500, 500),
    ),
    "anycubic_i3_mega": Vendor(
        "0.20mm QUALITY @MEGA, Anycubic 2.1.1",
        (40, 50, 60, 50, 40, 40, 25, 25, 180, 20, 20),
        (1000, 800, 800, 1000, 1000, 1000, 1000, 800, 1000),
        *(12, 10, 15),
        (300, 800),
    ),
    "artillery_genius": Vendor(
        "0.20mm NORMAL @Artillery, Artillery 1.1.1",
        (25, 45, 50, 50, 30, 30, 20, 25, 130, 20, 20),
        (1000, 800, 800, 1000, 1000, 1000, 1000, 500, 1000),
        *(12, 15, 15),
        (200, 1000),
    ),
    "prusa_mk3s": Vendor(
        f"0.20mm QUALITY @MK3, {_PRUSA}",
        (25, 45, 80, 80, 40, 40, 25, 25, 180, 20, 20),
        (1000, 800, 800, 1000, 1000, 1000, 1000, 800, 1000),
        *(15, 12, 15),
        (200, 1000),
    ),
    "prusa_mini": Vendor(
        f"0.20mm SPEED @MINIIS 0.4, {_PRUSA}",
        (140, 140, 140, 140, 80, 80, 50, 140, 400, 30, 45),
        (2000, 2000, 2500, 4000, 4000, 1000, 1500, 500, 4000),
        *(14, 12, 15),
        (180, 1250),
    ),
    "prusa_mk4": Vendor(
        f"0.20mm SPEED @MK4IS 0.4, {_PRUSA}",
        (170, 170, 200, 200, 100, 120, 50, 170, 300, 40, 100),
        (4000, 4000, 4000, 4000, 4000, 1500, 1500, 500, 4000),
        *(15, 8, 15),
        (200, 2000),
    ),
    "sovol_sv06": Vendor(
        "0.20mm SPEED @SV06, Sovol 2.1.0",
        (35, 60, 200, 200, 50, 40, 25, 25, 180, 20, 20),
        (1000, 800, 800, 1000, 1000, 1000, 1000, 800, 1000),
        *(15, 10, 15),
        (200, 1000),
    ),
    "ratrig_vcore3_300": Vendor(
        "QUALITY_0.20mm_Nozzle_0.4_VC3, RatRig 2.2.0",
        (200, 350, 350, 350, 140, 200, 35, 200, 500, 50, 50),
        (10000, 3000, 8000, 10000, 10000, 10000, 10000, 1500, 10000),
        *(20, 8, 10),
        (300, 3000),
    ),
    "voron_2_4_350": Vendor(
        "0.20mm Standard @VORON2 - 0.4mm, Voron 3.0.0",
        (170, 170, 200, 200, 100, 120, 50, 170, 350, 45, 100),
        (3000, 3000, 6000, 7000, 7000, 2000, 3000, 500, 7000),
        *(13, 8, 10),
        (300, 3000),
    ),
    "creality_k1": Vendor(
        "0.20mm Standard @Creality K1 0.4 nozzle, CrealityPrint of February 2025: there is no bundle of it",
        (200, 300, 270, 250, 200, 250, 50, 200, 500, 60, 60),
        (10000, 5000, 5000, 10000, 10000, 2000, 5000, 1000, 10000),
        *(23, 6, 20),
        (500, 5000),
    ),
}
"""Published processes by the names of the shipped printers."""
