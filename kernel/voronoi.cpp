// Segment Voronoi diagrams by Boost.Polygon; the twin is in printer_slicer/geometry/voronoi_diagram.py.

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "boost/polygon/voronoi_builder.hpp"
#include "boost/polygon/voronoi_diagram.hpp"
#include "exact_circle.hpp"
#include "functions.hpp"

namespace {

using Builder = boost::polygon::voronoi_builder<std::int32_t, exact::Traits>;
using Library = boost::polygon::voronoi_diagram<double>;
using Cell = Library::cell_type;
using Edge = Library::edge_type;

// Returns 1 for the cell of a side's start, 2 for that of its end, 3 or 4 for that of the side itself.
std::int64_t place_of(const Cell& cell) {
  if (cell.source_category() == boost::polygon::SOURCE_CATEGORY_INITIAL_SEGMENT) return 3;
  if (cell.source_category() == boost::polygon::SOURCE_CATEGORY_REVERSE_SEGMENT) return 4;
  return static_cast<std::int64_t>(cell.source_category());
}

// Diagrams of many areas, one after the other, numbered separately: see `_RawDiagrams` in voronoi_diagram.py.
struct Diagrams {
  std::vector<std::int64_t> around, begins, counts, sites, sizes;
  std::vector<double> vertices;

  void append(const Library& diagram) {
    const std::size_t before = around.size();
    for (const Cell& cell : diagram.cells()) append_cell(diagram, cell, before);
    if (around.size() - before != diagram.num_edges()) throw Invalid{"sides cross"};
    for (const auto& vertex : diagram.vertices()) {
      vertices.push_back(vertex.x());
      vertices.push_back(vertex.y());
    }
    sizes.push_back(static_cast<std::int64_t>(diagram.num_edges()));
    sizes.push_back(static_cast<std::int64_t>(diagram.num_cells()));
    sizes.push_back(static_cast<std::int64_t>(diagram.num_vertices()));
  }

 private:
  // The edges around a cell follow each other in a ring, unless sides cross.
  void append_cell(const Library& diagram, const Cell& cell, std::size_t before) {
    const std::size_t first = around.size();
    if (const Edge* edge = cell.incident_edge()) {
      do {
        if (around.size() - before == diagram.num_edges()) throw Invalid{"sides cross"};
        around.push_back(edge - diagram.edges().data());
        begins.push_back(edge->vertex0() ? edge->vertex0() - diagram.vertices().data() : -1);
        edge = edge->next();
      } while (edge && edge != cell.incident_edge());
      if (!edge) throw Invalid{"sides cross"};
    }
    counts.push_back(static_cast<std::int64_t>(around.size() - first));
    sites.push_back(static_cast<std::int64_t>(cell.source_index()));
    sites.push_back(place_of(cell));
  }
};

std::int32_t to_coordinate(std::int64_t value) {
  if (value < std::numeric_limits<std::int32_t>::min() || value > std::numeric_limits<std::int32_t>::max())
    throw Invalid{"a coordinate has more than 32 bits"};
  return static_cast<std::int32_t>(value);
}

// `side` holds x and y of start and end of each side, `count` the number of sides of each area.
Diagrams compute(const std::int64_t* side, const std::int64_t* count, std::size_t n_areas) {
  Diagrams result;
  Library diagram;
  for (std::size_t area = 0; area < n_areas; ++area) {
    Builder builder;
    for (std::int64_t i = 0; i < count[area]; ++i, side += 4)
      builder.insert_segment(to_coordinate(side[0]), to_coordinate(side[1]), to_coordinate(side[2]),
                             to_coordinate(side[3]));
    diagram.clear();
    builder.construct(&diagram);
    result.append(diagram);
  }
  return result;
}

// Whether the areas have at least one side each, and as many as there are in all.
bool matches(const Numbers& sides, const Numbers& counts) {
  if (!sides.is_whole() || !counts.is_whole() || sides.size() % 4) return false;
  std::uint64_t left = sides.size() / 4;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const std::int64_t count = counts.data()[i];
    if (count < 1 || static_cast<std::uint64_t>(count) > left) return false;
    left -= static_cast<std::uint64_t>(count);
  }
  return left == 0;
}

}  // namespace

PyObject* voronoi_diagrams(PyObject*, PyObject* arguments) {
  PyObject *sides_object, *counts_object;
  if (!PyArg_ParseTuple(arguments, "OO:voronoi_diagrams", &sides_object, &counts_object)) return nullptr;
  Numbers sides(sides_object);
  if (!sides.valid()) return nullptr;
  Numbers counts(counts_object);
  if (!counts.valid()) return nullptr;
  Diagrams result;
  const bool succeeded = run([&] {
    if (!matches(sides, counts)) throw Invalid{"the numbers of sides do not match the sides"};
    result = compute(sides.data(), counts.data(), counts.size());
  });
  if (!succeeded) return nullptr;
  return to_tuple(result.around, result.begins, result.counts, result.sites, result.vertices, result.sizes);
}
