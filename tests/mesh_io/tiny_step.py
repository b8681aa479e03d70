"""A box as a hand-written STEP file (ISO 10303-21, AP214)."""

from __future__ import annotations

from collections.abc import Sequence

__all__ = ["step_box"]

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
"""
SIDES = (
    ((0, 2, 3, 1), (0, 0, -1), (1, 0, 0)),
    ((4, 5, 7, 6), (0, 0, 1), (1, 0, 0)),
    ((0, 1, 5, 4), (0, -1, 0), (1, 0, 0)),
    ((2, 6, 7, 3), (0, 1, 0), (1, 0, 0)),
    ((0, 4, 6, 2), (-1, 0, 0), (0, 1, 0)),
    ((1, 3, 7, 5), (1, 0, 0), (0, 1, 0)),
)
"""Corners, normal, direction within the face."""


class _Box:
    """Entities in the order in which they are made."""

    def __init__(self, size: Sequence[float]) -> None:
        self.lines: list[str] = []
        self.points = [[size[axis] * (corner >> axis & 1) for axis in range(3)] for corner in range(8)]
        self.corners = [self.add(f"VERTEX_POINT('',{self.point(point)})") for point in self.points]
        self.edges: dict[tuple[int, int], str] = {}

    def add(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1}={text};")
        return f"#{len(self.lines)}"

    def point(self, values: Sequence[float], kind: str = "CARTESIAN_POINT") -> str:
        return self.add(f"{kind}('',({','.join(repr(float(value)) for value in values)}))")

    def axes(self, place: Sequence[float], normal: Sequence[float], along: Sequence[float]) -> str:
        parts = [self.point(place), self.point(normal, "DIRECTION"), self.point(along, "DIRECTION")]
        return self.add(f"AXIS2_PLACEMENT_3D('',{','.join(parts)})")

    def edge(self, begin: int, end: int) -> str:
        """An edge as a face runs along it."""
        if (end, begin) in self.edges:
            return self.add(f"ORIENTED_EDGE('',*,*,{self.edges[end, begin]},.F.)")
        way = [b - a for a, b in zip(self.points[begin], self.points[end], strict=True)]
        along = self.add(
            f"VECTOR('',{self.point([part / sum(map(abs, way)) for part in way], 'DIRECTION')},1.)"
        )
        line = self.add(f"LINE('',{self.point(self.points[begin])},{along})")
        curve = f"EDGE_CURVE('',{self.corners[begin]},{self.corners[end]},{line},.T.)"
        self.edges[begin, end] = self.add(curve)
        return self.add(f"ORIENTED_EDGE('',*,*,{self.edges[begin, end]},.T.)")

    def face(self, corners: Sequence[int], normal: Sequence[float], along: Sequence[float]) -> str:
        edges = [self.edge(*pair) for pair in zip(corners, [*corners[1:], corners[0]], strict=True)]
        loop = self.add(f"EDGE_LOOP('',({','.join(edges)}))")
        bound = self.add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        plane = self.add(f"PLANE('',{self.axes(self.points[corners[0]], normal, along)})")
        return self.add(f"ADVANCED_FACE('',({bound}),{plane},.T.)")


def step_box(x: float, y: float, z: float, *, prefix: str = ".MILLI.") -> str:
    """A box from the origin.

    Args:
        x, y, z: its edges.
        prefix: of the unit metre: `.MILLI.`, `$` for none.
    """
    box = _Box((x, y, z))
    shell = box.add(f"CLOSED_SHELL('',({','.join(box.face(*side) for side in SIDES)}))")
    solid = box.add(f"MANIFOLD_SOLID_BREP('',{shell})")
    length = box.add(f"(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({prefix},.METRE.))")
    angle = box.add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    round_angle = box.add("(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())")
    sure = box.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'','')")
    context = box.add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({sure}))"
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{angle},{round_angle}))REPRESENTATION_CONTEXT('',''))"
    )
    origin = box.axes((0, 0, 0), (0, 0, 1), (1, 0, 0))
    shape = box.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({origin},{solid}),{context})")
    use = box.add("APPLICATION_CONTEXT('automotive design')")
    box.add(f"APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,{use})")
    branch = box.add(f"PRODUCT_CONTEXT('',{use},'mechanical')")
    product = box.add(f"PRODUCT('box','box','',({branch}))")
    formation = box.add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    stage = box.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{use},'design')")
    definition = box.add(f"PRODUCT_DEFINITION('design','',{formation},{stage})")
    owner = box.add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    box.add(f"SHAPE_DEFINITION_REPRESENTATION({owner},{shape})")
    return HEAD + "\n".join(box.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"
