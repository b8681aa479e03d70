// Offsets with round joins, and areas around open lines, with Clipper2. The twins are in printer_slicer/geometry/clipper.py.

#include "clipper2/clipper.engine.h"
#include "clipper2/clipper.offset.h"
#include "functions.hpp"
#include "rings.hpp"

namespace {

using Clipper2Lib::EndType;
using Clipper2Lib::Path64;
using Clipper2Lib::Paths64;

constexpr double ROUND_TOLERANCE = 0.005;  // as in polygons.py
constexpr double NO_MITERS = 2.0;  // all joins are round

NewRings inflate(const Rings& paths, const Numbers& distance, EndType ends) {
  if (!distance.is_whole() || distance.size() != paths.size()) throw Invalid{"expected one distance per path"};
  NewRings result;
  result.xy.reserve(4 * paths.n_points());
  Clipper2Lib::ClipperOffset inflater(NO_MITERS, ROUND_TOLERANCE * STEPS_PER_MM);
  Paths64 group, found;
  for (std::size_t i = 0; i < paths.size();) {
    const std::int64_t number = paths.layer(i);
    const double by = distance.doubles()[i] * STEPS_PER_MM;
    group.clear();
    for (; i < paths.size() && paths.layer(i) == number; ++i) group.push_back(paths.on_grid(i));
    inflater.Clear();
    inflater.AddPaths(group, Clipper2Lib::JoinType::Round, ends);
    inflater.Execute(by, found);
    for (const Path64& ring : found) result.append(ring, number);
  }
  return result;
}

}  // namespace

PyObject* inflate_paths(PyObject*, PyObject* arguments) {
  PyObject* arrays[4];
  int is_closed;
  if (!PyArg_ParseTuple(arguments, "OOOOp:inflate_paths", &arrays[0], &arrays[1], &arrays[2], &arrays[3], &is_closed))
    return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]), group(arrays[2]), distance(arrays[3]);
  if (!distance.valid()) return nullptr;
  NewRings result;
  const bool succeeded = run([&] {
    result = inflate(Rings(xy, start, group), distance, is_closed ? EndType::Polygon : EndType::Round);
  });
  return succeeded ? to_tuple(std::move(result.xy), std::move(result.start), std::move(result.layer)) : nullptr;
}
