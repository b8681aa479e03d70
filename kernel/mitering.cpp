// Offsets of rings with mitered corners. The twin is mitering.py: it says what the steps are for.

#include <algorithm>
#include <cmath>
#include <utility>

#include "functions.hpp"
#include "rings.hpp"

namespace {

using Clipper2Lib::Path64;

constexpr double GENTLE = 0.5, BACK = -0.999, LEAST = 0.5;  // as in mitering.py and clipper.py

struct Corner {
  Corner(double x_, double y_) : x(x_), y(y_) {}
  double x, y;
  double vx = 0, vy = 0, ux = 0, uy = 0;  // directions of the previous and the next edge
  double cosine = 0, sine = 0;            // of the turn
  double length = 0;                      // of the next edge
  bool is_cut = false, passes_through = false;
};

class Miter {
 public:
  explicit Miter(double limit) : limit_squared_(limit * limit) {}

  // Moves a ring by a number of steps; returns no points for a ring without area.
  const Path64& move(const Path64& ring, double by) {
    corners_.clear();
    for (std::size_t i = 0; i < ring.size(); ++i)
      if (ring[i] != ring[i + 1 < ring.size() ? i + 1 : 0])
        corners_.emplace_back(static_cast<double>(ring[i].x), static_cast<double>(ring[i].y));
    measure_corners();
    choose_joins(by);
    moved_.clear();
    for (const Corner& corner : corners_) append(corner, by);
    return moved_;
  }

 private:
  std::size_t following(std::size_t i) const { return i + 1 < corners_.size() ? i + 1 : 0; }

  void measure_corners() {
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      Corner &corner = corners_[i], &next = corners_[following(i)];
      const double x = next.x - corner.x, y = next.y - corner.y;
      corner.length = std::sqrt(x * x + y * y);
      next.vx = corner.ux = x / corner.length;
      next.vy = corner.uy = y / corner.length;
    }
    for (Corner& corner : corners_) {
      corner.cosine = corner.vx * corner.ux + corner.vy * corner.uy;
      corner.sine = corner.vx * corner.uy - corner.vy * corner.ux;
    }
  }

  void choose_joins(double by) {
    gained_.clear();
    for (Corner& corner : corners_) {
      const bool is_outer = corner.sine * by >= 0 || corner.cosine <= BACK;
      corner.is_cut = is_outer && limit_squared_ * (1 + corner.cosine) <= 2;
      corner.passes_through = !is_outer && corner.cosine < GENTLE;
      gained_.push_back(by * (corner.is_cut ? 0.0 : corner.sine / (1 + std::max(corner.cosine, BACK))));
    }
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      if (!(corners_[i].length + gained_[i] + gained_[following(i)] < 0)) continue;
      for (Corner* corner : {&corners_[i], &corners_[following(i)]})
        corner->passes_through |= !(corner->sine * by >= 0 || corner->cosine <= BACK);
    }
  }

  void append(const Corner& corner, double by) {
    const double x = corner.x, y = corner.y, vx = corner.vx, vy = corner.vy, ux = corner.ux, uy = corner.uy;
    if (corner.is_cut) {
      double out_x = vx - ux, out_y = vy - uy;
      const double size = std::hypot(out_x, out_y) / std::abs(by);
      out_x /= size;
      out_y /= size;
      const double half =
          std::tan(std::acos(std::min(std::max(corner.cosine, -1.0), 1.0)) / 4) * (by < 0 ? -1.0 : 1.0);
      append(x + (out_x + out_y * half), y + (out_y - out_x * half));
      append(x + (out_x - out_y * half), y + (out_y + out_x * half));
    } else if (corner.passes_through) {
      append(x + vy * by, y + -vx * by);
      append(x, y);
      append(x + uy * by, y + -ux * by);
    } else {
      const double share = by / (1 + std::max(corner.cosine, BACK));
      append(x + (uy + vy) * share, y - (ux + vx) * share);
    }
  }

  void append(double x, double y) {
    moved_.emplace_back(round_to_integer(x), round_to_integer(y));
  }

  double limit_squared_;
  std::vector<Corner> corners_;
  std::vector<double> gained_;
  Path64 moved_;
};

}  // namespace

PyObject* miter_areas(PyObject*, PyObject* arguments) {
  PyObject* arrays[4];
  double limit;
  if (!PyArg_ParseTuple(arguments, "OOOOd:miter_areas", &arrays[0], &arrays[1], &arrays[2], &arrays[3], &limit))
    return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]), layer(arrays[2]), distance(arrays[3]);
  for (const Numbers* numbers : {&xy, &start, &layer, &distance})
    if (!numbers->valid()) return nullptr;
  NewRings result;
  const bool succeeded = run([&] {
    const Rings rings(xy, start, layer);
    if (!distance.is_whole() || distance.size() != rings.size()) throw Invalid{"expected one distance per ring"};
    result.xy.reserve(2 * rings.n_points());
    Miter miter(limit);
    for (std::size_t i = 0; i < rings.size(); ++i) {
      const double by = distance.doubles()[i] * STEPS_PER_MM;
      const Path64 ring = rings.on_grid(i);
      const Path64& moved = std::abs(by) >= LEAST ? miter.move(ring, by) : ring;
      if (!moved.empty()) result.append(moved, rings.layer(i));
    }
  });
  return succeeded ? to_tuple(std::move(result.xy), std::move(result.start), std::move(result.layer)) : nullptr;
}
