// Edges of Voronoi diagrams that belong to the medial axis; the twin is in printer_slicer/geometry/medial_axis.py.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

// A side of an outline, with the points before and after it.
struct Side {
  Point before, begin, end, after;
};

// The cell of an edge: the index of a side, and 1 for the corner at its begin, 2 for that at its end, 3 or 4 for itself.
struct Cell {
  std::int64_t side, place;

  bool is_corner() const { return place <= 2; }
};

struct Edge {
  Point start, end;
};

// Returns the place of a cell; a corner is a side without length.
Side side_of(const Side* sides, Cell cell) {
  const Side& side = sides[cell.side];
  if (cell.place == 1) return {side.before, side.begin, side.begin, side.end};
  if (cell.place == 2) return {side.begin, side.end, side.end, side.after};
  return side;
}

// Whether a point is inside the areas, as far as a side or corner tells.
bool is_inside(const Side& side, bool is_corner, Point point) {
  if (!is_corner) return cross(side.end - side.begin, point - side.begin) > 0;
  const bool around = cross(side.begin - side.before, point - side.before) > 0 ||
                      cross(side.after - side.begin, point - side.begin) > 0;
  return around && cross(side.begin - side.before, side.after - side.begin) < 0;
}

bool is_within(const Side& side, Point point, double reach) {
  return norm(point - nearest_on_segment(point, side.begin, side.end)) <= reach;
}

// Whether both edges of a pair of twins are inside the areas and near the outlines.
bool is_inner(const Side* sides, const Cell* cell, const Edge* edge, double reach) {
  bool inside[2], near[2];
  for (int i = 0; i < 2; ++i) {
    const Side side = side_of(sides, cell[i]);
    inside[i] = is_inside(side, cell[i].is_corner(), 0.5 * (edge[i].start + edge[i].end));
    near[i] = is_within(side, edge[i].start, reach) || is_within(side, edge[i].end, reach);
  }
  if (!near[0] || !near[1]) return false;
  if (cell[0].is_corner() == cell[1].is_corner()) return inside[0] && inside[1];
  return cell[0].is_corner() ? inside[1] : inside[0];  // the side decides
}

}  // namespace

PyObject* inner_edges(PyObject*, PyObject* arguments) {
  PyObject *sides_object, *cells_object, *ends_object;
  double reach;
  if (!PyArg_ParseTuple(arguments, "OOOd:inner_edges", &sides_object, &cells_object, &ends_object, &reach))
    return nullptr;
  Numbers sides(sides_object);
  if (!sides.valid()) return nullptr;
  Numbers cells(cells_object);
  if (!cells.valid()) return nullptr;
  Numbers ends(ends_object);
  if (!ends.valid()) return nullptr;
  std::vector<std::uint8_t> result;
  const bool succeeded = run([&] {
    const std::size_t n = cells.size() / 2;
    if (!sides.is_whole() || !cells.is_whole() || !ends.is_whole() || sides.size() % 8 || cells.size() % 4 ||
        ends.size() != 4 * n)
      throw Invalid{"the numbers of cells and ends do not match"};
    const Side* side = reinterpret_cast<const Side*>(sides.doubles());
    const Cell* cell = reinterpret_cast<const Cell*>(cells.data());
    const Edge* edge = reinterpret_cast<const Edge*>(ends.doubles());
    for (std::size_t i = 0; i < n; ++i)
      if (cell[i].side < 0 || static_cast<std::size_t>(cell[i].side) >= sides.size() / 8)
        throw Invalid{"a cell has a side that does not exist"};
    result.resize(n);
    for (std::size_t i = 0; i < n; i += 2)
      result[i] = result[i + 1] = is_inner(side, cell + i, edge + i, reach);
  });
  return succeeded ? to_bytes(result) : nullptr;
}
