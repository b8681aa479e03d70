// The points of paths that are needed; the twin is in printer_slicer/perimeters/simplification.py.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

struct Place {
  double x, y, width;
};

// A point that may be removed; `total` includes what its segments have changed before.
struct Candidate {
  std::size_t point;
  double deviation, total;
  bool is_first;  // deviates less than both neighbours
};

double deviation_of(const Place& point, const Place& begin, const Place& end) {
  const Point along{end.x - begin.x, end.y - begin.y}, gap{point.x - begin.x, point.y - begin.y};
  const double share = std::min(std::max(dot(gap, along) / std::max(dot(along, along), 1e-18), 0.0), 1.0);
  const Point away = gap - share * along;
  return std::max(norm(away), std::fabs((point.width - begin.width) - share * (end.width - begin.width)));
}

class Simplification {
 public:
  Simplification(const Place* place, std::size_t n, const std::int64_t* size, const std::int64_t* closed,
                 std::size_t n_paths)
      : kept(n, 1), place_(place), closed_(closed), left_(size, size + n_paths), going_(n_paths), before_(n),
        after_(n), path_(n), moved_(n), rank_(n, std::numeric_limits<double>::infinity()) {
    std::size_t first = 0;
    for (std::size_t path = 0; path < n_paths; first += static_cast<std::size_t>(size[path++])) {
      const std::size_t last = first + static_cast<std::size_t>(size[path]) - 1;
      for (std::size_t i = first; i <= last; ++i) {
        before_[i] = i == first ? last : i - 1;
        after_[i] = i == last ? first : i + 1;
        path_[i] = path;
        if (size[path] > 2 && (closed[path] || (i != first && i != last))) left_over_.push_back({i, 0, 0, false});
      }
    }
  }

  // Removes points in rounds, never two neighbours at a time.
  void run(double tolerance) {
    do {
      select(tolerance);
      find_first();
    } while (remove_first());
  }

  std::vector<std::uint8_t> kept;

 private:
  // Leaves only candidates within the tolerance.
  void select(double tolerance) {
    std::size_t n = 0;
    for (Candidate& candidate : left_over_) {
      const std::size_t i = candidate.point, prior = before_[i];
      candidate.deviation = deviation_of(place_[i], place_[prior], place_[after_[i]]);
      candidate.total = candidate.deviation + std::max(moved_[prior], moved_[i]);
      const bool is_good = candidate.total <= tolerance;
      rank_[i] = is_good ? candidate.deviation : std::numeric_limits<double>::infinity();
      if (is_good) left_over_[n++] = candidate;
    }
    left_over_.resize(n);
  }

  bool is_under(const Candidate& candidate, std::size_t other) const {
    return candidate.deviation < rank_[other] ||
           (candidate.deviation == rank_[other] && candidate.point < other);
  }

  void find_first() {
    std::fill(going_.begin(), going_.end(), 0);
    for (Candidate& candidate : left_over_) {
      const std::size_t i = candidate.point;
      candidate.is_first = is_under(candidate, before_[i]) && is_under(candidate, after_[i]);
      going_[path_[i]] += candidate.is_first;
    }
  }

  // Returns whether any points were removed; a closed path keeps three points at least.
  bool remove_first() {
    std::size_t n = 0;
    const std::size_t before = left_over_.size();
    for (const Candidate& candidate : left_over_) {
      const std::size_t i = candidate.point, path = path_[i];
      if (!candidate.is_first || (closed_[path] && left_[path] - going_[path] < 3)) {
        left_over_[n++] = candidate;
        continue;
      }
      moved_[before_[i]] = candidate.total;
      before_[after_[i]] = before_[i];
      after_[before_[i]] = after_[i];
      kept[i] = 0;
      rank_[i] = std::numeric_limits<double>::infinity();
    }
    left_over_.resize(n);
    for (std::size_t path = 0; path < left_.size(); ++path)
      if (!closed_[path] || left_[path] - going_[path] >= 3) left_[path] -= going_[path];
    return n < before;
  }

  const Place* place_;
  const std::int64_t* closed_;
  std::vector<std::int64_t> left_, going_;  // points of each path
  std::vector<std::size_t> before_, after_, path_;
  std::vector<double> moved_, rank_;  // `moved_` is of the segment that begins at each point
  std::vector<Candidate> left_over_;
};

// Whether the paths have at least one point each, and as many as there are in all.
bool matches(const Numbers& points, const Numbers& sizes, const Numbers& closed) {
  if (!points.is_whole() || !sizes.is_whole() || !closed.is_whole()) return false;
  if (points.size() % 3 || sizes.size() != closed.size()) return false;
  std::uint64_t left = points.size() / 3;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    const std::int64_t size = sizes.data()[i];
    if (size < 1 || static_cast<std::uint64_t>(size) > left) return false;
    left -= static_cast<std::uint64_t>(size);
  }
  return left == 0;
}

}  // namespace

PyObject* points_to_keep(PyObject*, PyObject* arguments) {
  PyObject *points_object, *sizes_object, *closed_object;
  double tolerance;
  if (!PyArg_ParseTuple(arguments, "OOOd:points_to_keep", &points_object, &sizes_object, &closed_object, &tolerance))
    return nullptr;
  Numbers points(points_object);
  if (!points.valid()) return nullptr;
  Numbers sizes(sizes_object);
  if (!sizes.valid()) return nullptr;
  Numbers closed(closed_object);
  if (!closed.valid()) return nullptr;
  std::vector<std::uint8_t> result;
  const bool succeeded = run([&] {
    if (!matches(points, sizes, closed)) throw Invalid{"the sizes of paths do not match the points"};
    Simplification paths(reinterpret_cast<const Place*>(points.doubles()), points.size() / 3, sizes.data(),
                         closed.data(), sizes.size());
    paths.run(tolerance);
    result = std::move(paths.kept);
  });
  return succeeded ? to_bytes(result) : nullptr;
}
