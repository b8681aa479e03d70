// Sides and corners of outlines that face each other; the twin is in printer_slicer/perimeters/facing_sides.py.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

constexpr double SLACK = 1e-6;  // mm

// A side, and the corner at its beginning: unit normals into the area, of this side and of the previous one; largest
// distance between facing sides; and whether the corner points into the area, 0 or 1.
struct Side {
  Point begin, end, normal, normal_before;
  double layer, reach, inward;
};

struct Box {
  double low[2], high[2];
};

Box box_of(const Side& side) {
  return {{std::min(side.begin.x, side.end.x), std::min(side.begin.y, side.end.y)},
          {std::max(side.begin.x, side.end.x), std::max(side.begin.y, side.end.y)}};
}

bool is_near(Point point, const Side& side, double reach) {
  return norm(point - nearest_on_segment(point, side.begin, side.end)) <= reach && dot(point - side.begin, side.normal) > -SLACK;
}

bool is_parallel(const Side& a, const Side& b, double cosine) {
  return dot(a.normal, b.normal) <= -cosine &&
         (is_near(a.begin, b, a.reach) || is_near(a.end, b, a.reach) || is_near(b.begin, a, a.reach) ||
          is_near(b.end, a, a.reach));
}

// Whether a direction lies between the normals of the two sides of a corner.
bool contains(const Side& corner, Point direction) {
  const double size = std::max(norm(direction), 1e-12) * 1e-3;
  return cross(corner.normal_before, direction) <= size && cross(corner.normal, direction) >= -size &&
         dot(corner.normal_before + corner.normal, direction) > 0;
}

bool corner_faces_side(const Side& a, const Side& b) {
  if (!a.inward) return false;
  const double height = dot(a.begin, b.normal) - dot(b.begin, b.normal);
  if (!(height > SLACK && height <= a.reach)) return false;
  const Point foot = a.begin - height * b.normal, along = b.end - b.begin;
  const double place = dot(foot - b.begin, along);
  return place > -SLACK && place < dot(along, along) + SLACK && contains(a, -b.normal);
}

bool corners_face(const Side& a, const Side& b) {
  if (!a.inward || !b.inward) return false;
  const Point way = b.begin - a.begin;
  return dot(way, way) <= a.reach * a.reach && contains(a, way) && contains(b, -way);
}

bool is_facing(const Side& a, const Side& b, double cosine) {
  return is_parallel(a, b, cosine) || corner_faces_side(a, b) || corner_faces_side(b, a) || corners_face(a, b);
}

// Calls `visit` for each pair of sides on one layer whose boxes, grown by half of the reach, overlap or touch.
template <typename Visit>
void visit_neighbours(const Side* side, std::size_t n, const Visit& visit) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  std::vector<Box> boxes(n);
  for (std::size_t i = 0; i < n; ++i) {
    boxes[i] = box_of(side[i]);
    const double room = side[i].reach / 2;
    for (double& low : boxes[i].low) low -= room;
    for (double& high : boxes[i].high) high += room;
    least = std::min(least, boxes[i].low[0]);
    most = std::max(most, boxes[i].high[0]);
  }
  const double pitch = most - least + 1.0;  // layers lie beside each other
  for (std::size_t i = 0; i < n; ++i) {
    boxes[i].low[0] += side[i].layer * pitch;
    boxes[i].high[0] += side[i].layer * pitch;
  }
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return boxes[a].low[0] != boxes[b].low[0] ? boxes[a].low[0] < boxes[b].low[0] : a < b;
  });
  for (std::size_t i = 0; i < n; ++i) {
    const Box& own = boxes[order[i]];
    for (std::size_t j = i + 1; j < n && boxes[order[j]].low[0] <= own.high[0]; ++j) {
      const Box& other = boxes[order[j]];
      if (own.low[1] <= other.high[1] && other.low[1] <= own.high[1]) visit(order[i], order[j]);
    }
  }
}

// Grows a box by the part of a side that is within reach of another one.
void include(Box& box, const Box& own, const Box& other, double reach) {
  for (int axis = 0; axis < 2; ++axis) {
    box.low[axis] = std::min(box.low[axis], std::max(own.low[axis], other.low[axis] - reach));
    box.high[axis] = std::max(box.high[axis], std::min(own.high[axis], other.high[axis] + reach));
  }
}

std::vector<Box> find(const Side* side, std::size_t n, double cosine) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  std::vector<Box> result(n, Box{{infinity, infinity}, {-infinity, -infinity}});
  visit_neighbours(side, n, [&](std::size_t a, std::size_t b) {
    if (!is_facing(side[a], side[b], cosine)) return;
    const Box one = box_of(side[a]), other = box_of(side[b]);
    include(result[a], one, other, side[a].reach);
    include(result[b], other, one, side[a].reach);
  });
  return result;
}

}  // namespace

PyObject* facing_boxes(PyObject*, PyObject* arguments) {
  PyObject* object;
  double cosine;
  if (!PyArg_ParseTuple(arguments, "Od:facing_boxes", &object, &cosine)) return nullptr;
  Numbers numbers(object);
  if (!numbers.valid()) return nullptr;
  constexpr std::size_t columns = sizeof(Side) / sizeof(double);
  std::vector<Box> result;
  const bool succeeded = run([&] {
    if (!numbers.is_whole() || numbers.size() % columns) throw Invalid{"a side does not have 11 numbers"};
    result = find(reinterpret_cast<const Side*>(numbers.doubles()), numbers.size() / columns, cosine);
  });
  return succeeded ? to_bytes(result) : nullptr;
}
