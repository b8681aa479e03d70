// Search tree for segments in the plane: the results of planar.SegmentTree, many times faster.
//
// Segments that follow each other are near each other. So each box of the lowest level surrounds some segments in their
// given order, each box of the next level some of these boxes, and so on. Nothing is sorted.

#include <algorithm>
#include <limits>
#include <utility>

#include "functions.hpp"
#include "segments.hpp"

namespace {

constexpr std::size_t WIDTH = 8;  // segments or boxes in a box
constexpr double ROUNDING = 1e-8;  // mm; a segment may seem that much nearer than the box around it

struct Box {
  double low_x, low_y, high_x, high_y;

  bool touches(const Box& that) const {
    return low_x <= that.high_x && that.low_x <= high_x && low_y <= that.high_y && that.low_y <= high_y;
  }
  double distance_to(const Point& point) const {
    return distance_between({std::min(std::max(point.x, low_x), high_x), std::min(std::max(point.y, low_y), high_y)}, point);
  }
  void include(const Box& that) {
    low_x = std::min(low_x, that.low_x);
    low_y = std::min(low_y, that.low_y);
    high_x = std::max(high_x, that.high_x);
    high_y = std::max(high_y, that.high_y);
  }
};

// The box around a segment, or between two corners: x and y of two points.
Box box_of(const double* ends) {
  return {std::min(ends[0], ends[2]), std::min(ends[1], ends[3]), std::max(ends[0], ends[2]),
          std::max(ends[1], ends[3])};
}

std::size_t groups_of(std::size_t count) { return (count + WIDTH - 1) / WIDTH; }

// Returns the number of boxes on each level, from the lowest one to the single box around everything.
std::vector<std::size_t> sizes_of(std::size_t n_segments) {
  std::vector<std::size_t> sizes(1, groups_of(n_segments));
  while (sizes.back() > 1) sizes.push_back(groups_of(sizes.back()));
  return sizes;
}

std::vector<Box> build(const double* ends, std::size_t n_segments) {
  std::vector<Box> boxes;
  for (std::size_t i = 0; i < n_segments; ++i) {
    const Box box = box_of(ends + 4 * i);
    if (i % WIDTH == 0) boxes.push_back(box);
    boxes.back().include(box);
  }
  std::size_t first = 0;
  for (std::size_t size : sizes_of(n_segments)) {
    if (size == 1) break;
    for (std::size_t i = 0; i < size; ++i) {
      const Box box = boxes[first + i];
      if (i % WIDTH == 0) boxes.push_back(box);
      boxes.back().include(box);
    }
    first += size;
  }
  return boxes;
}

class Tree {
 public:
  Tree(const double* ends, std::size_t n_segments, const Box* boxes) : ends_(ends), n_(n_segments) {
    for (std::size_t size : sizes_of(n_segments)) {
      levels_.push_back(boxes);
      boxes += size;
    }
    sizes_ = sizes_of(n_segments);
  }

  void find(const Box& box, std::vector<std::int64_t>* segments) const { visit(levels_.size() - 1, 0, box, segments); }

  // Returns the segment nearest to a point, the first of several.
  std::int64_t find_nearest(const Point& point) const {
    Nearest nearest{point};
    approach(levels_.size() - 1, 0, &nearest);
    return nearest.segment;
  }

 private:
  struct Nearest {
    Point point;
    double distance = std::numeric_limits<double>::infinity();
    std::int64_t segment = 0;
  };

  // Looks for nearer segments in a box, first in the nearest of the boxes within.
  void approach(std::size_t level, std::size_t index, Nearest* nearest) const {
    const std::size_t first = index * WIDTH;
    if (!level) {
      for (std::size_t i = first, last = std::min(first + WIDTH, n_); i < last; ++i) {
        const double* const ends = ends_ + 4 * i;
        const double distance = distance_to_segment(nearest->point, {ends[0], ends[1]}, {ends[2], ends[3]});
        const auto segment = static_cast<std::int64_t>(i);
        if (distance > nearest->distance || (distance == nearest->distance && segment > nearest->segment)) continue;
        nearest->distance = distance;
        nearest->segment = segment;
      }
      return;
    }
    double distance[WIDTH];
    const std::size_t n = std::min(WIDTH, sizes_[level - 1] - first);
    for (std::size_t i = 0; i < n; ++i) distance[i] = levels_[level - 1][first + i].distance_to(nearest->point);
    const auto begin = static_cast<std::size_t>(std::min_element(distance, distance + n) - distance);
    approach(level - 1, first + begin, nearest);
    for (std::size_t i = 0; i < n; ++i)
      if (i != begin && distance[i] <= nearest->distance + ROUNDING) approach(level - 1, first + i, nearest);
  }

  void visit(std::size_t level, std::size_t index, const Box& box, std::vector<std::int64_t>* segments) const {
    if (!levels_[level][index].touches(box)) return;
    const std::size_t first = index * WIDTH;
    if (level) {
      for (std::size_t i = first, last = std::min(first + WIDTH, sizes_[level - 1]); i < last; ++i)
        visit(level - 1, i, box, segments);
    } else {
      for (std::size_t i = first, last = std::min(first + WIDTH, n_); i < last; ++i)
        if (box_of(ends_ + 4 * i).touches(box)) segments->push_back(static_cast<std::int64_t>(i));
    }
  }

  const double* ends_;
  std::size_t n_;
  std::vector<const Box*> levels_;
  std::vector<std::size_t> sizes_;
};

bool is_whole(const Numbers& numbers, std::size_t period) { return numbers.is_whole() && numbers.size() % period == 0; }

// Returns the tree of segments and their boxes, which must stay alive.
Tree tree_of(const Numbers& ends, const Numbers& boxes) {
  if (!is_whole(ends, 4) || !is_whole(boxes, 4)) throw Invalid{"a segment or box has four numbers"};
  const std::size_t n_segments = ends.size() / 4;
  std::size_t n_boxes = 0;
  for (std::size_t size : sizes_of(n_segments)) n_boxes += size;
  if (!n_segments || n_boxes != boxes.size() / 4) throw Invalid{"the boxes do not match the segments"};
  return {ends.doubles(), n_segments, reinterpret_cast<const Box*>(boxes.doubles())};
}

}  // namespace

PyObject* build_polyline_tree(PyObject*, PyObject* ends_object) {
  Numbers ends(ends_object);
  if (!ends.valid()) return nullptr;
  std::vector<Box> boxes;
  const bool succeeded = run([&] {
    if (!is_whole(ends, 4)) throw Invalid{"a segment has four numbers"};
    boxes = build(ends.doubles(), ends.size() / 4);
  });
  return succeeded ? to_bytes(boxes) : nullptr;
}

PyObject* query_polyline_tree(PyObject*, PyObject* arguments) {
  PyObject *ends_object, *boxes_object, *queries_object;
  if (!PyArg_ParseTuple(arguments, "OOO:query_polyline_tree", &ends_object, &boxes_object, &queries_object)) return nullptr;
  Numbers ends(ends_object);
  if (!ends.valid()) return nullptr;
  Numbers boxes(boxes_object);
  if (!boxes.valid()) return nullptr;
  Numbers queries(queries_object);
  if (!queries.valid()) return nullptr;
  std::vector<std::int64_t> query, segments;
  const bool succeeded = run([&] {
    if (!is_whole(queries, 4)) throw Invalid{"a segment or box has four numbers"};
    const Tree tree = tree_of(ends, boxes);
    for (std::size_t i = 0; i < queries.size() / 4; ++i) {
      tree.find(box_of(queries.doubles() + 4 * i), &segments);
      query.resize(segments.size(), static_cast<std::int64_t>(i));
    }
  });
  return succeeded ? to_tuple(std::move(query), std::move(segments)) : nullptr;
}

PyObject* nearest_segments(PyObject*, PyObject* arguments) {
  PyObject *ends_object, *boxes_object, *points_object;
  if (!PyArg_ParseTuple(arguments, "OOO:nearest_segments", &ends_object, &boxes_object, &points_object)) return nullptr;
  const Numbers ends(ends_object), boxes(boxes_object), points(points_object);
  if (!ends.valid() || !boxes.valid() || !points.valid()) return nullptr;
  std::vector<std::int64_t> segments;
  const bool succeeded = run([&] {
    if (!is_whole(points, 2)) throw Invalid{"a point has two numbers"};
    const Tree tree = tree_of(ends, boxes);
    const Point* const point = reinterpret_cast<const Point*>(points.doubles());
    for (std::size_t i = 0; i < points.size() / 2; ++i) segments.push_back(tree.find_nearest(point[i]));
  });
  return succeeded ? to_bytes(segments) : nullptr;
}
