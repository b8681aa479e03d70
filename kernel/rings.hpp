// The rings of a stack of layers: those of class Areas in Python, as arguments and as results.

#ifndef PRINTER_SLICER_RINGS
#define PRINTER_SLICER_RINGS

#include <cstddef>
#include <cstdint>
#include <vector>

#include "clipper2/clipper.core.h"
#include "python.hpp"
#include "rounding.hpp"

constexpr double STEPS_PER_MM = 100000;  // as in polygons.py

// Rings in arrays of Python, which must stay alive.
class Rings {
 public:
  // Throws Invalid if the arrays do not match.
  Rings(const Numbers& xy, const Numbers& start, const Numbers& layer)
      : xy_(xy.doubles()), start_(start.data()), layer_(layer.data()), size_(layer.size()) {
    if (!xy.is_whole() || !start.is_whole() || !layer.is_whole() || start.size() != size_ + 1 || start_[0])
      throw Invalid{"the arrays of the rings do not match"};
    for (std::size_t i = 0; i < size_; ++i)
      if (start_[i] > start_[i + 1] || (i && layer_[i - 1] > layer_[i])) throw Invalid{"rings must ascend"};
    if (static_cast<std::size_t>(start_[size_]) * 2 != xy.size()) throw Invalid{"there are not as many points"};
  }

  std::size_t size() const { return size_; }
  std::size_t n_points() const { return static_cast<std::size_t>(start_[size_]); }
  std::int64_t layer(std::size_t ring) const { return layer_[ring]; }
  std::size_t length(std::size_t ring) const { return static_cast<std::size_t>(start_[ring + 1] - start_[ring]); }
  const double* points(std::size_t ring) const { return xy_ + 2 * start_[ring]; }

  // Returns a ring in steps of the grid.
  Clipper2Lib::Path64 on_grid(std::size_t ring) const {
    Clipper2Lib::Path64 result;
    result.reserve(length(ring));
    const double* const end = xy_ + 2 * start_[ring + 1];
    for (const double* at = points(ring); at != end; at += 2)
      result.emplace_back(round_to_integer(at[0] * STEPS_PER_MM),
                          round_to_integer(at[1] * STEPS_PER_MM));
    return result;
  }

 private:
  const double* xy_;
  const std::int64_t *start_, *layer_;
  std::size_t size_;
};

// Rings that become arrays of Python.
struct NewRings {
  std::vector<double> xy;
  std::vector<std::int64_t> start{0}, layer;

  void append(const Clipper2Lib::Path64& ring, std::int64_t of_layer) {
    for (const Clipper2Lib::Point64& point : ring) {
      xy.push_back(static_cast<double>(point.x) / STEPS_PER_MM);
      xy.push_back(static_cast<double>(point.y) / STEPS_PER_MM);
    }
    start.push_back(static_cast<std::int64_t>(xy.size() / 2));
    layer.push_back(of_layer);
  }
};

#endif
