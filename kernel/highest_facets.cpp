// The highest facet over points within heights; the twin is `FacetBins.find_facets` in
// printer_slicer/contouring/surface_heights.py.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "functions.hpp"

namespace {

constexpr double ROUNDING = 1e-6;  // mm, and tangents of slopes; as in surface_heights.py
constexpr std::size_t N_COLUMNS = 13, N_POINT = 5;

// The columns of a facet: its plane, its slope, its corners, and how far beside its sides a point is on it.
struct Facet {
  double z, x_slope, y_slope, slope, corner[3][2], beside[3];

  bool contains(double x, double y) const {
    for (int one = 0; one < 3; ++one) {
      const double *begin = corner[one], *end = corner[(one + 1) % 3];
      const double side_x = end[0] - begin[0], side_y = end[1] - begin[1];
      if (!(side_x * (y - begin[1]) - side_y * (x - begin[0]) >= beside[one])) return false;
    }
    return true;
  }
};
static_assert(sizeof(Facet) == N_COLUMNS * sizeof(double), "a facet has only its columns");

struct Point {
  double x, y, bottom, top, steepest;
};
static_assert(sizeof(Point) == N_POINT * sizeof(double), "a point has only its columns");

// The highest of some facets over a point, the last of several; -1 if there is none.
std::int64_t find_highest(const Point& point, const std::int64_t* begin, const std::int64_t* end,
                          const Facet* facets) {
  std::int64_t found = -1;
  double highest = 0.0;
  for (const std::int64_t* one = begin; one != end; ++one) {
    const Facet& facet = facets[*one];
    const double z = facet.z + facet.x_slope * point.x + facet.y_slope * point.y;
    if (!(z >= point.bottom - ROUNDING && z <= point.top + ROUNDING)) continue;
    if (found >= 0 && z < highest) continue;
    if (facet.slope > point.steepest + ROUNDING || !facet.contains(point.x, point.y)) continue;
    found = *one;
    highest = z;
  }
  return found;
}

void check_numbers(const Numbers& numbers, std::size_t limit, std::int64_t least, const char* message) {
  for (std::size_t i = 0; i < numbers.size(); ++i)
    if (numbers.data()[i] < least || numbers.data()[i] >= static_cast<std::int64_t>(limit)) throw Invalid{message};
}

// Columns have whole rows, starts ascend within the list of facets, and numbers belong to something.
void check(const Numbers& points, const Numbers& bins, const Numbers& start, const Numbers& listed,
           const Numbers& facets) {
  for (const Numbers* one : {&points, &bins, &start, &listed, &facets})
    if (!one->is_whole()) throw Invalid{"an array is not made of whole numbers of 8 bytes"};
  if (points.size() != N_POINT * bins.size() || facets.size() % N_COLUMNS || !start.size())
    throw Invalid{"an array has another shape"};
  check_numbers(bins, start.size() - 1, -1, "a point is in a bin that does not exist");
  check_numbers(listed, facets.size() / N_COLUMNS, 0, "a bin has a facet that does not exist");
  check_numbers(start, listed.size() + 1, 0, "a bin is beyond the list of facets");
  for (std::size_t i = 1; i < start.size(); ++i)
    if (start.data()[i] < start.data()[i - 1]) throw Invalid{"the bins do not ascend"};
}

}  // namespace

PyObject* highest_facets(PyObject*, PyObject* arguments) {
  PyObject *points_object, *bins_object, *start_object, *listed_object, *facets_object;
  if (!PyArg_ParseTuple(arguments, "OOOOO:highest_facets", &points_object, &bins_object, &start_object,
                        &listed_object, &facets_object))
    return nullptr;
  Numbers points(points_object), bins(bins_object), start(start_object), listed(listed_object);
  Numbers facets(facets_object);
  for (const Numbers* one : {&points, &bins, &start, &listed, &facets})
    if (!one->valid()) return nullptr;
  std::vector<std::int64_t> result;
  const bool succeeded = run([&] {
    check(points, bins, start, listed, facets);
    const auto* columns = reinterpret_cast<const Point*>(points.doubles());
    const auto* table = reinterpret_cast<const Facet*>(facets.doubles());
    result.assign(bins.size(), -1);
    for (std::size_t i = 0; i < bins.size(); ++i) {
      const std::int64_t bin = bins.data()[i];
      if (bin < 0) continue;
      const std::int64_t *begin = listed.data() + start.data()[bin], *end = listed.data() + start.data()[bin + 1];
      result[i] = find_highest(columns[i], begin, end, table);
    }
  });
  return succeeded ? to_bytes(std::move(result)) : nullptr;
}
