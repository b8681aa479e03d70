// The parts of outlines within areas, layer by layer. The twin is `outlines_within` in clipper.py.

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

#include "clipper2/clipper.engine.h"
#include "functions.hpp"
#include "rings.hpp"

namespace {

using Clipper2Lib::Path64;
using Clipper2Lib::Paths64;
using Clipper2Lib::Point64;

// The bounding box of areas.
struct Box {
  std::int64_t low_x = std::numeric_limits<std::int64_t>::max(), low_y = low_x;
  std::int64_t high_x = std::numeric_limits<std::int64_t>::min(), high_y = high_x;

  void add(const Path64& ring) {
    for (const Point64& point : ring) {
      low_x = std::min(low_x, point.x);
      low_y = std::min(low_y, point.y);
      high_x = std::max(high_x, point.x);
      high_y = std::max(high_y, point.y);
    }
  }
  bool meets(const Point64& a, const Point64& b) const {
    return std::min(a.x, b.x) <= high_x && std::max(a.x, b.x) >= low_x && std::min(a.y, b.y) <= high_y &&
           std::max(a.y, b.y) >= low_y;
  }
};

// Appends the sides of a ring near the box as open lines; sides that follow each other form one line.
void select_near_lines(const Path64& ring, const Box& box, Paths64* lines) {
  bool continues = false;
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Point64& end = ring[i + 1 < ring.size() ? i + 1 : 0];
    const bool near = box.meets(ring[i], end);
    if (near && !continues) lines->push_back({ring[i]});
    if (near) lines->back().push_back(end);
    continues = near;
  }
}

// Joins lines that were cut at the first point of their ring.
void rejoin_lines(Paths64& lines) {
  const auto key = [](const Point64& point) { return std::make_pair(point.x, point.y); };
  std::map<std::pair<std::int64_t, std::int64_t>, std::size_t> begins;
  for (std::size_t i = 0; i < lines.size(); ++i) begins[key(lines[i].front())] = i;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (lines[i].empty()) continue;
    const auto after = begins.find(key(lines[i].back()));
    if (after == begins.end() || after->second == i || lines[after->second].empty()) continue;
    Path64& whole = lines[after->second];
    whole.insert(whole.begin(), lines[i].begin(), lines[i].end() - 1);
    lines[i].clear();
  }
}

NewRings clip(const Rings& outlines, const Rings& areas) {
  NewRings result;
  Clipper2Lib::Clipper64 clipper;
  Paths64 lines, clips, closed, within;
  for (std::size_t i = 0, k = 0; i < outlines.size() && k < areas.size();) {
    const std::int64_t layer = std::max(outlines.layer(i), areas.layer(k));
    lines.clear();
    clips.clear();
    Box box;
    for (; k < areas.size() && areas.layer(k) <= layer; ++k) {
      if (areas.layer(k) < layer) continue;
      clips.push_back(areas.on_grid(k));
      box.add(clips.back());
    }
    for (; i < outlines.size() && outlines.layer(i) <= layer; ++i)
      if (outlines.layer(i) == layer) select_near_lines(outlines.on_grid(i), box, &lines);
    if (lines.empty() || clips.empty()) continue;
    clipper.Clear();
    clipper.AddOpenSubject(lines);
    clipper.AddClip(clips);
    if (!clipper.Execute(Clipper2Lib::ClipType::Intersection, Clipper2Lib::FillRule::Positive, closed, within))
      throw Invalid{"Clipper2 failed"};
    rejoin_lines(within);
    for (const Path64& line : within)
      if (!line.empty()) result.append(line, layer);
  }
  return result;
}

}  // namespace

PyObject* clip_outlines(PyObject*, PyObject* arguments) {
  PyObject* arrays[6];
  if (!PyArg_ParseTuple(arguments, "OOOOOO:clip_outlines", &arrays[0], &arrays[1], &arrays[2], &arrays[3], &arrays[4],
                        &arrays[5]))
    return nullptr;
  const Numbers xy(arrays[0]), start(arrays[1]), layer(arrays[2]);
  const Numbers areas_xy(arrays[3]), areas_start(arrays[4]), areas_layer(arrays[5]);
  for (const Numbers* numbers : {&xy, &start, &layer, &areas_xy, &areas_start, &areas_layer})
    if (!numbers->valid()) return nullptr;
  NewRings result;
  const bool succeeded =
      run([&] { result = clip(Rings(xy, start, layer), Rings(areas_xy, areas_start, areas_layer)); });
  return succeeded ? to_tuple(std::move(result.xy), std::move(result.start), std::move(result.layer)) : nullptr;
}
