"""Make the winding of neighbouring facets consistent."""

from __future__ import annotations

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.healing.facets import Facets
from printer_slicer.model import Repair

__all__ = ["orient_consistently"]


def orient_consistently(facets: Facets, name: str) -> tuple[Facets, list[Repair]]:
    """Flip facets until neighbours face the same way; in each patch, flip the group with less area.

    Each facet is two nodes of a graph, as it is and flipped. Neighbours link the nodes that face the same way. In a
    one-sided patch both nodes of a facet are connected.

    Raises:
        MeshError: the surface is one-sided, like a Möbius strip.
    """
    pair, same = facets.pair_neighbours()
    if same.all():
        return facets, []
    n = len(facets.corners)
    one, other = pair
    links = np.concatenate(
        [np.stack([one, other + n * ~same]), np.stack([one + n, other + n * same])], axis=1
    )
    side = label_components(links, 2 * n)
    as_is, turned = side[:n], side[n:]
    twisted = np.flatnonzero(as_is == turned)
    if len(twisted):
        x, y, z = facets.centroids[twisted[0]]
        raise MeshError(
            f"{name}: the surface is one-sided around x {x:.2f} y {y:.2f} z {z:.2f} and encloses no solid",
            remedy="Close the mesh in the program that made it",
        )
    # Keep the side of each patch that has more area already.
    area = np.linalg.norm(facets.normals, axis=1)
    n_sides = int(side.max()) + 1
    weight = np.bincount(as_is, area, n_sides) - np.bincount(turned, area, n_sides)
    turn = (weight[as_is] < 0) | ((weight[as_is] == 0) & (as_is > turned))
    return facets.flip(turn), [Repair("facets turned round", facets.centroids[turn])]
