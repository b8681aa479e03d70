// Blocks of moves and the speeds at their corners, for firmware that limits jerk. The twin is motion/vectorized.py.

#include <algorithm>
#include <cmath>

#include "functions.hpp"

namespace {

// As in motion/blocks.py; the limits of a machine follow as an array of doubles.
struct Limits {
  double shortest, slowest, acceleration, travel_acceleration, retract_acceleration, min_segment_seconds;
  double max_speed[4], max_acceleration[4], jerk[4];
};

struct Block {
  double unit[4], speed;
};

struct Blocks {
  std::vector<std::int64_t> moving;
  std::vector<double> length, speed, acceleration, share, corner;
};

// Lowers a value such that part * value is at most the maximum.
void limit_product(double* value, double part, double maximum) {
  if (part * *value > maximum) *value = maximum / part;
}

// Returns the squared speed at the corner between two blocks.
double squared_corner_speed(const Block& before, const Block& after, const Limits& limits) {
  double speed = std::min(before.speed, after.speed);
  for (int axis = 0; axis < 4; ++axis) {
    const double b = before.unit[axis], a = after.unit[axis];
    const double jump = a * b > 0 ? std::abs(a - b) : std::max(std::abs(a), std::abs(b));
    limit_product(&speed, jump, limits.jerk[axis]);
  }
  return speed * speed;
}

// `requested` has the acceleration of each move, or is null.
Blocks make(const double* delta, const double* speed, const double* requested, std::size_t n, const Limits& limits) {
  Blocks result;
  Block last{};
  for (std::size_t i = 0; i < n; ++i) {
    const double x = delta[4 * i], y = delta[4 * i + 1], z = delta[4 * i + 2], e = delta[4 * i + 3];
    const double way = std::sqrt(x * x + y * y + z * z);
    const bool head_moves = way >= limits.shortest;
    const double length = head_moves ? way : std::abs(e);
    if (!(length >= limits.shortest)) continue;
    Block block{{0, 0, 0, static_cast<double>((e > 0) - (e < 0))}, speed[i]};
    if (head_moves)
      for (int axis = 0; axis < 4; ++axis) block.unit[axis] = delta[4 * i + axis] / length;
    const double asked = requested      ? requested[i]
                         : !head_moves  ? limits.retract_acceleration
                         : e != 0       ? limits.acceleration
                                        : limits.travel_acceleration;
    if (limits.min_segment_seconds > 0) block.speed = std::min(block.speed, length / limits.min_segment_seconds);
    if (!(block.speed > limits.slowest)) block.speed = limits.slowest;
    double acceleration = asked;
    for (int axis = 0; axis < 4; ++axis) {
      limit_product(&block.speed, std::abs(block.unit[axis]), limits.max_speed[axis]);
      limit_product(&acceleration, std::abs(block.unit[axis]), limits.max_acceleration[axis]);
    }
    result.corner.push_back(result.moving.empty() ? 0 : squared_corner_speed(last, block, limits));
    result.moving.push_back(static_cast<std::int64_t>(i));
    result.length.push_back(length);
    result.speed.push_back(block.speed);
    result.acceleration.push_back(acceleration);
    result.share.push_back(acceleration / asked);
    last = block;
  }
  return result;
}

}  // namespace

PyObject* make_blocks(PyObject*, PyObject* arguments) {
  PyObject *delta_object, *speed_object, *requested_object, *limits_object;
  if (!PyArg_ParseTuple(arguments, "OOOO:make_blocks", &delta_object, &speed_object, &requested_object, &limits_object))
    return nullptr;
  const Numbers delta(delta_object), speed(speed_object), requested(requested_object), limits(limits_object);
  if (!limits.valid()) return nullptr;
  Blocks result;
  const bool succeeded = run([&] {
    if (!delta.is_whole() || !speed.is_whole() || !requested.is_whole() || delta.size() != 4 * speed.size() ||
        (requested.size() && requested.size() != speed.size()))
      throw Invalid{"the moves do not match"};
    if (!limits.is_whole() || limits.size() * sizeof(double) != sizeof(Limits)) throw Invalid{"unexpected limits"};
    result = make(delta.doubles(), speed.doubles(), requested.size() ? requested.doubles() : nullptr, speed.size(),
                  *reinterpret_cast<const Limits*>(limits.doubles()));
  });
  return succeeded ? to_tuple(result.moving, result.length, result.speed, result.acceleration, result.share, result.corner)
                   : nullptr;
}
