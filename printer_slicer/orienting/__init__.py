"""Turn a part so that it prints in little time, with little support and a smooth surface.

mesh -> shape of the part in its own axes (`part_shape`) -> directions that may point down (`directions`)
     -> rough ratings of all directions from few samples of the surface (`rough_ratings`)
     -> ratings of the best ones: supports that land on the part, bridges, layers (`ratings`)
     -> rotations (`turning`) -> `Orientations`, best first (`search`)

A direction is rated by one sum: print time, plus the price of the support that it needs, plus the price of the surface
deviation. All of it is computed in the part's own axes, so the result does not depend on how the part lies in its
file. Directions in which the part falls over or does not fit the printer come last.

`printer_slicer.orientation` slices the best ones and measures them, if the user wants that.
"""

from printer_slicer.orienting.cost_model import CostModel
from printer_slicer.orienting.orientations import Orientation, Orientations
from printer_slicer.orienting.search import find_fast_orientations, sort_orientations
from printer_slicer.orienting.turning import turn_mesh

__all__ = [
    "CostModel",
    "Orientation",
    "Orientations",
    "find_fast_orientations",
    "sort_orientations",
    "turn_mesh",
]
