// The search for spikes of outlines. The twin is `is_spike` in spikes.py.

#include <algorithm>
#include <cmath>

#include "functions.hpp"
#include "rings.hpp"

namespace {

constexpr double MOST = 2 / STEPS_PER_MM;  // mm, as in spikes.py

bool is_spike(const double* before, const double* at, const double* after) {
  const double in_x = at[0] - before[0], in_y = at[1] - before[1], out_x = after[0] - at[0], out_y = after[1] - at[1];
  if (out_x * in_x + out_y * in_y > 0) return false;
  const double longer = std::max(std::hypot(in_x, in_y), std::hypot(out_x, out_y));
  return std::abs(in_x * out_y - in_y * out_x) <= longer * MOST;
}

}  // namespace

PyObject* find_spikes(PyObject*, PyObject* arguments) {
  PyObject* arrays[3];
  if (!PyArg_ParseTuple(arguments, "OOO:find_spikes", &arrays[0], &arrays[1], &arrays[2])) return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]), layer(arrays[2]);
  for (const Numbers* numbers : {&xy, &start, &layer})
    if (!numbers->valid()) return nullptr;
  std::vector<std::uint8_t> result;
  const bool succeeded = run([&] {
    const Rings rings(xy, start, layer);
    result.reserve(rings.n_points());
    for (std::size_t ring = 0; ring < rings.size(); ++ring) {
      const double* const first = rings.points(ring);
      const std::size_t n = rings.length(ring);
      for (std::size_t i = 0; i < n; ++i)
        result.push_back(is_spike(first + 2 * (i ? i - 1 : n - 1), first + 2 * i, first + 2 * (i + 1 < n ? i + 1 : 0)));
    }
  });
  return succeeded ? to_bytes(result) : nullptr;
}
