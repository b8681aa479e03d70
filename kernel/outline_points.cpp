// The points of outlines that remain when these are simplified; the twin is shapely's, see outline_simplification.py.
//
// Source: Douglas & Peucker, Algorithms for the reduction of the number of points required to represent a digitized line
// or its caricature, 1973.

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "functions.hpp"
#include "segments.hpp"

namespace {

using Stretch = std::pair<std::size_t, std::size_t>;  // the first and the last point

class Ring {
 public:
  Ring(const Point* points, std::size_t size, double tolerance) : points_(points), size_(size), tolerance_(tolerance) {}

  // Marks the points that remain; the stretches are only memory to use.
  void mark(std::uint8_t* kept, std::vector<Stretch>* stretches) const {
    stretches->assign(1, {0, size_});  // the ring ends with its first point
    while (!stretches->empty()) {
      const Stretch stretch = stretches->back();
      stretches->pop_back();
      kept[stretch.first] = 1;
      if (stretch.second - stretch.first < 2) continue;
      const std::size_t farthest = find_farthest(stretch);
      if (!farthest) continue;
      stretches->push_back({stretch.first, farthest});
      stretches->push_back({farthest, stretch.second});
    }
    drop_start(kept);
  }

 private:
  const Point& at(std::size_t i) const { return points_[i == size_ ? 0 : i]; }

  // Returns the point that is farthest from the chord of a stretch, or 0 if all are within the tolerance.
  std::size_t find_farthest(const Stretch& stretch) const {
    double most = -1;
    std::size_t found = 0;
    for (std::size_t i = stretch.first + 1; i < stretch.second; ++i) {
      const double distance = distance_to_segment(points_[i], at(stretch.first), at(stretch.second));
      if (distance > most) {
        most = distance;
        found = i;
      }
    }
    return most <= tolerance_ ? 0 : found;
  }

  // Removes the first point, too, if it is within the tolerance of the chord between its neighbours.
  void drop_start(std::uint8_t* kept) const {
    std::size_t n = 0, after = 0, before = 0;
    for (std::size_t i = 0; i < size_; ++i) {
      if (!kept[i]) continue;
      if (++n == 2) after = i;
      before = i;
    }
    if (n >= 3 && distance_to_segment(points_[0], points_[after], points_[before]) <= tolerance_) kept[0] = 0;
  }

  const Point* points_;
  std::size_t size_;
  double tolerance_;
};

}  // namespace

PyObject* outline_points(PyObject*, PyObject* arguments) {
  PyObject *xy_object, *start_object;
  double tolerance;
  if (!PyArg_ParseTuple(arguments, "OOd:outline_points", &xy_object, &start_object, &tolerance)) return nullptr;
  const Numbers xy(xy_object), start(start_object);
  if (!xy.valid() || !start.valid()) return nullptr;
  std::vector<std::uint8_t> kept;
  const bool succeeded = run([&] {
    if (!xy.is_whole() || !start.is_whole() || !start.size() || start.data()[0])
      throw Invalid{"the arrays of the rings do not match"};
    const std::size_t n_rings = start.size() - 1;
    for (std::size_t i = 0; i < n_rings; ++i)
      if (start.data()[i] > start.data()[i + 1]) throw Invalid{"rings must ascend"};
    if (static_cast<std::size_t>(start.data()[n_rings]) * 2 != xy.size()) throw Invalid{"there are not as many points"};
    kept.assign(xy.size() / 2, 0);
    const Point* points = reinterpret_cast<const Point*>(xy.doubles());
    std::vector<Stretch> stretches;
    for (std::size_t i = 0; i < n_rings; ++i) {
      const auto first = static_cast<std::size_t>(start.data()[i]);
      const auto size = static_cast<std::size_t>(start.data()[i + 1]) - first;
      if (size) Ring(points + first, size, tolerance).mark(kept.data() + first, &stretches);
    }
  });
  return succeeded ? to_bytes(kept) : nullptr;
}
