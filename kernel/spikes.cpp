// Spikes and areas of outlines. The twins are spikes.py and `Areas.ring_area`.

#include <algorithm>
#include <cmath>

#include "functions.hpp"
#include "rings.hpp"
#include "sums.hpp"

namespace {

// As in spikes.py.
constexpr double MOST = 2 / STEPS_PER_MM;           // mm
constexpr double LEAST = 1 / STEPS_PER_MM + 1e-11;  // mm

// A point of an outline with spikes.
struct Corner {
  double at[2];
  std::size_t index;  // among all points
  bool is_spike;
};
using Outline = std::vector<Corner>;

bool is_spike(const double* before, const double* at, const double* after) {
  const double in_x = at[0] - before[0], in_y = at[1] - before[1], out_x = after[0] - at[0], out_y = after[1] - at[1];
  if (out_x * in_x + out_y * in_y > 0) return false;
  const double longer = std::max(std::hypot(in_x, in_y), std::hypot(out_x, out_y));
  return std::abs(in_x * out_y - in_y * out_x) <= longer * MOST;
}

// Returns the signed area of the outline of n points.
template <typename PointOf>
double area_of(std::size_t n, const PointOf& point, std::vector<double>* terms) {
  if (!n) return 0;
  const double *const origin = point(0), *at = origin;
  terms->clear();
  for (std::size_t i = 0; i < n; ++i) {
    const double* const next = point(i + 1 < n ? i + 1 : 0);
    const double x = at[0] - origin[0], y = at[1] - origin[1];
    terms->push_back(x * (next[1] - origin[1]) - y * (next[0] - origin[0]));
    at = next;
  }
  return sum_like_numpy(terms->data(), n) / 2;
}

// Marks the spikes of an outline; returns whether there are any.
bool mark_spikes(Outline* outline) {
  bool any = false;
  const std::size_t n = outline->size();
  for (std::size_t i = 0; i < n; ++i) {
    Corner& corner = (*outline)[i];
    corner.is_spike = is_spike((*outline)[i ? i - 1 : n - 1].at, corner.at, (*outline)[i + 1 < n ? i + 1 : 0].at);
    any |= corner.is_spike;
  }
  return any;
}

// Returns whether the outline is at most one step of the grid wide on average, or has only spikes.
bool is_flat(const Outline& outline, std::vector<double>* terms) {
  if (std::all_of(outline.begin(), outline.end(), [](const Corner& corner) { return corner.is_spike; })) return true;
  const double area = area_of(outline.size(), [&](std::size_t i) { return outline[i].at; }, terms);
  terms->clear();
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const double *const at = outline[i].at, *const next = outline[i + 1 < outline.size() ? i + 1 : 0].at;
    terms->push_back(std::hypot(next[0] - at[0], next[1] - at[1]));
  }
  return 2 * std::abs(area) <= sum_like_numpy(terms->data(), terms->size()) * LEAST;
}

// Removes spikes, only one of several neighbouring ones at a time: then the next one may no longer be a spike.
void remove_spikes(Outline* outline, std::vector<double>* terms) {
  Outline kept;
  if (!is_flat(*outline, terms)) {
    bool before = outline->back().is_spike;
    for (const Corner& corner : *outline) {
      if (!corner.is_spike || before) kept.push_back(corner);
      before = corner.is_spike;
    }
  }
  if (kept.size() < 3) kept.clear();
  outline->swap(kept);
}

// Returns the outlines with spikes.
std::vector<Outline> find_outlines_with_spikes(const Rings& rings) {
  std::vector<Outline> result;
  Outline outline;
  std::size_t index = 0;
  for (std::size_t ring = 0; ring < rings.size(); ++ring) {
    const double* const first = rings.points(ring);
    const std::size_t n = rings.length(ring);
    bool any = false;
    for (std::size_t i = 0; i < n && !any; ++i)
      any = is_spike(first + 2 * (i ? i - 1 : n - 1), first + 2 * i, first + 2 * (i + 1 < n ? i + 1 : 0));
    if (any) {
      outline.clear();
      for (std::size_t i = 0; i < n; ++i) outline.push_back({{first[2 * i], first[2 * i + 1]}, index + i, false});
      mark_spikes(&outline);
      result.push_back(outline);
    }
    index += n;
  }
  return result;
}

// Copies the rings; of those with spikes, which are given before and after these were removed, only what is left.
NewRings copy_without(const Rings& rings, const std::vector<std::size_t>& first, const std::vector<Outline>& left) {
  NewRings result;
  result.xy.reserve(2 * rings.n_points());
  std::size_t index = 0, k = 0;
  for (std::size_t ring = 0; ring < rings.size(); index += rings.length(ring++)) {
    const std::size_t size = result.xy.size();
    if (k < first.size() && first[k] == index && rings.length(ring)) {
      for (const Corner& corner : left[k]) result.xy.insert(result.xy.end(), corner.at, corner.at + 2);
      ++k;
    } else if (rings.length(ring) >= 3) {
      result.xy.insert(result.xy.end(), rings.points(ring), rings.points(ring) + 2 * rings.length(ring));
    }
    if (result.xy.size() == size) continue;
    result.start.push_back(static_cast<std::int64_t>(result.xy.size() / 2));
    result.layer.push_back(rings.layer(ring));
  }
  return result;
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

PyObject* remove_spikes(PyObject*, PyObject* arguments) {
  PyObject* arrays[3];
  if (!PyArg_ParseTuple(arguments, "OOO:remove_spikes", &arrays[0], &arrays[1], &arrays[2])) return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]), layer(arrays[2]);
  for (const Numbers* numbers : {&xy, &start, &layer})
    if (!numbers->valid()) return nullptr;
  NewRings result;
  bool any = false;
  const bool succeeded = run([&] {
    const Rings rings(xy, start, layer);
    std::vector<Outline> outlines = find_outlines_with_spikes(rings);
    any = !outlines.empty();
    if (!any) return;
    std::vector<std::size_t> first;
    for (const Outline& outline : outlines) first.push_back(outline.front().index);
    std::vector<double> terms;
    // A round looks at all of these outlines once more, also at those without spikes.
    for (bool more = true; more;) {
      more = false;
      for (Outline& outline : outlines) {
        if (outline.empty()) continue;
        remove_spikes(&outline, &terms);
        more |= mark_spikes(&outline);
      }
    }
    result = copy_without(rings, first, outlines);
  });
  if (!succeeded) return nullptr;
  if (!any) Py_RETURN_NONE;
  return to_tuple(result.xy, result.start, result.layer);
}

PyObject* ring_areas(PyObject*, PyObject* arguments) {
  PyObject* arrays[2];
  if (!PyArg_ParseTuple(arguments, "OO:ring_areas", &arrays[0], &arrays[1])) return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]);
  if (!start.valid()) return nullptr;
  std::vector<double> result, terms;
  const bool succeeded = run([&] {
    if (!xy.is_whole() || !start.is_whole() || !start.size() || start.data()[0]) throw Invalid{"unexpected offsets"};
    for (std::size_t ring = 0; ring + 1 < start.size(); ++ring) {
      const std::int64_t begin = start.data()[ring], end = start.data()[ring + 1];
      if (end < begin || static_cast<std::size_t>(end) > xy.size() / 2) throw Invalid{"the rings do not match"};
      const double* const first = xy.doubles() + 2 * begin;
      const auto point = [&](std::size_t i) { return first + 2 * i; };
      result.push_back(area_of(static_cast<std::size_t>(end - begin), point, &terms));
    }
  });
  return succeeded ? to_bytes(result) : nullptr;
}
