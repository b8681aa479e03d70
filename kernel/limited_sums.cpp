// Running sums with limits, with the additions of accumulate_with_limit in motion/vectorized.py in the same order.

#include <algorithm>
#include <limits>

#include "functions.hpp"

namespace {

// The values are in rows of `width`; those after the last value are 0, as in the twin.
std::vector<double> accumulate(const double* bound, const double* gain, std::size_t n, std::size_t width, double first) {
  std::vector<double> result(n);
  double start = first;
  for (std::size_t row = 0; row < n; row += width) {
    const std::size_t end = std::min(row + width, n);
    double low = std::numeric_limits<double>::infinity(), rise = 0.0, value = start;
    for (std::size_t i = row; i < end; ++i) {
      value = std::min(bound[i], value + gain[i]);
      result[i] = value;
      low = std::min(bound[i], low + gain[i]);
      rise += gain[i];
    }
    start = std::min(low, start + rise);
  }
  return result;
}

}  // namespace

PyObject* accumulate_with_limit(PyObject*, PyObject* arguments) {
  PyObject *bound_object, *gain_object;
  double first;
  Py_ssize_t width;
  if (!PyArg_ParseTuple(arguments, "OOdn:accumulate_with_limit", &bound_object, &gain_object, &first, &width))
    return nullptr;
  Numbers bound(bound_object);
  if (!bound.valid()) return nullptr;
  Numbers gain(gain_object);
  if (!gain.valid()) return nullptr;
  std::vector<double> result;
  const bool succeeded = run([&] {
    if (!bound.is_whole() || !gain.is_whole() || bound.size() != gain.size() || width < 1)
      throw Invalid{"the limits do not match the gains"};
    result = accumulate(bound.doubles(), gain.doubles(), bound.size(), static_cast<std::size_t>(width), first);
  });
  return succeeded ? to_bytes(result) : nullptr;
}
