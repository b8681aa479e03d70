"""G-code of small parts, made by formula."""

from __future__ import annotations

from math import cos, pi, sin
from random import Random  # noqa: TID251 - seeded

HEAT = "M140 S60\nM104 S200\nM190 S60\nM109 S200\n"


def tower(
    layers: int, *, relative: bool = True, sides: int = 24, radius: float = 15.0, labels: bool = False
) -> str:
    """Loops over each other around (100, 100), with an arc and a long line in each; E relative or absolute."""
    text = [HEAT + "G28", "G90", "M83" if relative else "M82", "G92 E0", "M106 S128"]
    e = 0.0

    def lay(x: float, y: float, length: float) -> str:
        nonlocal e
        e += length * 0.033
        return f"G1 X{x:.3f} Y{y:.3f} E{length * 0.033 if relative else e:.5f}"

    for layer in range(layers):
        z = 0.2 * (layer + 1)
        text += [";LAYER_CHANGE", f"G1 Z{z:.2f} F600", f"G1 X{100 + radius:.3f} Y100.000 F6000"]
        if labels:
            text.append("; printing object tower id:0 copy 0")
        text.append("G1 F2400")
        step = 2 * radius * sin(pi / sides)
        text += [
            lay(100 + radius * cos(2 * pi * k / sides), 100 + radius * sin(2 * pi * k / sides), step)
            for k in range(1, sides + 1)
        ]
        text += [lay(100 - radius, 100, 2 * radius)]
        if not relative and layer % 3 == 2:
            text.append("G92 E0")
            e = 0.0
        if labels:
            text.append("; stop printing object tower id:0 copy 0")
    return "\n".join([*text, "M104 S0", "M140 S0", "M107"]) + "\n"


def scribble(seed: int, moves: int, *, relative: bool) -> str:
    """Lines of all lengths from a tenth of a millimetre to eighty, with travels and retractions between."""
    chance = Random(seed)
    text = [HEAT + "G28", "G90", "M83" if relative else "M82", "G92 E0", "G1 Z0.2 F600"]
    x = y = 100.0
    e = 0.0
    for _ in range(moves):
        size = chance.choice([0.1, 1.0, 8.0, 80.0])
        nx = min(max(x + chance.uniform(-size, size), 20.0), 180.0)
        ny = min(max(y + chance.uniform(-size, size), 20.0), 180.0)
        length = ((nx - x) ** 2 + (ny - y) ** 2) ** 0.5
        if chance.random() < 0.15:
            e -= 0.8
            text.append(f"G1 E{-0.8 if relative else e:.5f} F2100")
            text.append(f"G1 X{nx:.3f} Y{ny:.3f} F7200")
            e += 0.8
            text.append(f"G1 E{0.8 if relative else e:.5f} F1500")
        else:
            e += 0.03 * length
            text.append(
                f"G1 X{nx:.3f} Y{ny:.3f} E{0.03 * length if relative else e:.5f} F{chance.randrange(1200, 4800)}"
            )
        x, y = nx, ny
    return "\n".join(text) + "\n"
