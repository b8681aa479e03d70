// Where planes cut the edges of a mesh, and the rings of these points: the results of _cut_edges and _find_nodes in
// geometry/plane_sections.py, and of find_cycles in geometry/connectivity.py.

#include "functions.hpp"

namespace {

// Index `value` of an array with `size` entries.
std::size_t checked(std::int64_t value, std::size_t size) {
  if (value < 0 || static_cast<std::uint64_t>(value) >= size) throw Invalid{"an index is outside of its array"};
  return static_cast<std::size_t>(value);
}

struct Cuts {
  std::vector<double> xy;
  std::vector<std::int64_t> planes;
};

Cuts cut(const Numbers& corners, const Numbers& level, const Numbers& low, const Numbers& high, const Numbers& planes) {
  const std::size_t n_corners = level.size();
  if (corners.size() != 3 * n_corners || low.size() != high.size()) throw Invalid{"the arrays do not match"};
  const double *x = corners.doubles(), *y = x + n_corners, *z = y + n_corners;
  Cuts cuts;
  for (std::size_t i = 0; i < low.size(); ++i) {
    const std::size_t a = checked(low.data()[i], n_corners), b = checked(high.data()[i], n_corners);
    for (std::int64_t plane = level.data()[a]; plane < level.data()[b]; ++plane) {
      const double ratio = (planes.doubles()[checked(plane, planes.size())] - z[a]) / (z[b] - z[a]);
      // A corner that lies on the plane must keep its exact coordinates.
      cuts.xy.push_back(ratio == 1 ? x[b] : x[a] + ratio * (x[b] - x[a]));
      cuts.xy.push_back(ratio == 1 ? y[b] : y[a] + ratio * (y[b] - y[a]));
      cuts.planes.push_back(plane);
    }
  }
  return cuts;
}

std::vector<std::int64_t> number(const Numbers& level, const Numbers& edges, const Numbers& slot) {
  const std::size_t n_edges = edges.size() / 4, n_corners = level.size();
  const std::int64_t *item = edges.data(), *low = item + n_edges, *high = low + n_edges, *base = high + n_edges;
  if (edges.size() % 4 || (n_edges && !slot.size())) throw Invalid{"the arrays do not match"};
  std::int64_t count = 0;
  for (std::size_t i = 0; i < n_edges; ++i)
    count += level.data()[checked(high[i], n_corners)] - level.data()[checked(low[i], n_corners)];
  std::vector<std::int64_t> nodes(checked(count, std::size_t(1) << 40));
  for (std::size_t i = 0; i < n_edges; ++i) {
    const std::int64_t before = slot.data()[checked(item[i], n_corners) % slot.size()];
    for (std::int64_t plane = level.data()[low[i]]; plane < level.data()[high[i]]; ++plane)
      nodes[checked(before + plane, nodes.size())] = base[i] + plane;
  }
  return nodes;
}

struct Cycles {
  bool complete = true;  // whether each walk ends where it began
  std::vector<std::int64_t> lowest, steps;
};

Cycles follow(const Numbers& following) {
  const std::size_t n = following.size();
  Cycles cycles;
  cycles.lowest.assign(n, -1);
  cycles.steps.assign(n, 0);
  for (std::size_t first = 0; first < n; ++first) {
    std::size_t item = first;
    for (std::int64_t step = 0; cycles.lowest[item] < 0; ++step) {
      cycles.lowest[item] = static_cast<std::int64_t>(first);
      cycles.steps[item] = step;
      item = checked(following.data()[item], n);
    }
    cycles.complete = cycles.complete && (item == first || cycles.lowest[first] != static_cast<std::int64_t>(first));
  }
  return cycles;
}

}  // namespace

PyObject* find_cycles(PyObject*, PyObject* object) {
  Numbers following(object);
  if (!following.valid()) return nullptr;
  Cycles cycles;
  const bool succeeded = run([&] {
    if (!following.is_whole()) throw Invalid{"the arrays do not match"};
    cycles = follow(following);
  });
  if (!succeeded) return nullptr;
  if (!cycles.complete) Py_RETURN_NONE;
  return to_tuple(cycles.lowest, cycles.steps);
}

PyObject* cut_edges(PyObject*, PyObject* arguments) {
  PyObject* objects[5];
  if (!PyArg_ParseTuple(arguments, "OOOOO:cut_edges", objects, objects + 1, objects + 2, objects + 3, objects + 4))
    return nullptr;
  Numbers corners(objects[0]);
  if (!corners.valid()) return nullptr;
  Numbers level(objects[1]);
  if (!level.valid()) return nullptr;
  Numbers low(objects[2]);
  if (!low.valid()) return nullptr;
  Numbers high(objects[3]);
  if (!high.valid()) return nullptr;
  Numbers planes(objects[4]);
  if (!planes.valid()) return nullptr;
  Cuts cuts;
  const bool succeeded = run([&] {
    for (const Numbers* numbers : {&corners, &level, &low, &high, &planes})
      if (!numbers->is_whole()) throw Invalid{"the arrays do not match"};
    cuts = cut(corners, level, low, high, planes);
  });
  return succeeded ? to_tuple(std::move(cuts.xy), std::move(cuts.planes)) : nullptr;
}

PyObject* number_cuts(PyObject*, PyObject* arguments) {
  PyObject *level_object, *edges_object, *slot_object;
  if (!PyArg_ParseTuple(arguments, "OOO:number_cuts", &level_object, &edges_object, &slot_object)) return nullptr;
  Numbers level(level_object);
  if (!level.valid()) return nullptr;
  Numbers edges(edges_object);
  if (!edges.valid()) return nullptr;
  Numbers slot(slot_object);
  if (!slot.valid()) return nullptr;
  std::vector<std::int64_t> nodes;
  const bool succeeded = run([&] {
    for (const Numbers* numbers : {&level, &edges, &slot})
      if (!numbers->is_whole()) throw Invalid{"the arrays do not match"};
    nodes = number(level, edges, slot);
  });
  return succeeded ? to_bytes(nodes) : nullptr;
}
