// Union, difference and intersection of areas with Clipper2, layer by layer. The twin is clipper.py, with the same rings.

#include <algorithm>
#include <limits>
#include <utility>

#include "clipper2/clipper.engine.h"
#include "functions.hpp"
#include "rings.hpp"

namespace {

using Clipper2Lib::ClipType;
using Clipper2Lib::Path64;
using Clipper2Lib::Paths64;

constexpr ClipType OPERATIONS[] = {ClipType::Union, ClipType::Difference, ClipType::Intersection};
constexpr std::size_t CROWDED = 16;  // as in clipper.py

// A ring of a crowded layer.
struct Item {
  Path64* ring;
  bool is_clip;
  std::int64_t low, high;  // extent in x
};

class Combination {
 public:
  explicit Combination(ClipType operation) : operation_(operation) { clipper_.PreserveCollinear(false); }

  // Appends the result for one layer.
  void combine(Paths64& subjects, Paths64& clips, std::int64_t layer, NewRings* result) {
    if (subjects.size() + clips.size() < CROWDED || !split(subjects, clips)) {
      execute(subjects, clips, layer, result);
      return;
    }
    for (std::size_t i = 0; i < items_.size(); i = next_column_[i]) {
      column_subjects_.clear();
      column_clips_.clear();
      for (std::size_t k = i; k < next_column_[i]; ++k)
        (items_[k].is_clip ? column_clips_ : column_subjects_).push_back(std::move(*items_[k].ring));
      execute(column_subjects_, column_clips_, layer, result);
    }
  }

 private:
  void execute(const Paths64& subjects, const Paths64& clips, std::int64_t layer, NewRings* result) {
    const bool is_union = operation_ == ClipType::Union;
    if (subjects.empty() && (clips.empty() || !is_union)) return;
    if (clips.empty() && operation_ == ClipType::Intersection) return;
    clipper_.Clear();
    clipper_.AddSubject(subjects);
    clipper_.AddClip(clips);
    if (!clipper_.Execute(operation_, Clipper2Lib::FillRule::Positive, found_)) throw Invalid{"Clipper2 failed"};
    for (const Path64& ring : found_) result->append(ring, layer);
  }

  // Sorts the rings into columns with gaps in x between them; returns whether there are several.
  bool split(Paths64& subjects, Paths64& clips) {
    items_.clear();
    for (Paths64* paths : {&subjects, &clips})
      for (Path64& ring : *paths) {
        if (ring.empty()) continue;
        const auto less = [](const auto& a, const auto& b) { return a.x < b.x; };
        const auto ends = std::minmax_element(ring.begin(), ring.end(), less);
        items_.push_back({&ring, paths == &clips, ends.first->x, ends.second->x});
      }
    std::stable_sort(items_.begin(), items_.end(), [](const Item& a, const Item& b) { return a.low < b.low; });
    next_column_.assign(items_.size(), items_.size());
    std::size_t first = 0;
    std::int64_t reached = std::numeric_limits<std::int64_t>::max();
    for (std::size_t i = 0; i < items_.size(); ++i) {
      if (items_[i].low > reached) {
        next_column_[first] = i;
        first = i;
      }
      reached = i ? std::max(reached, items_[i].high) : items_[i].high;
    }
    return first > 0;
  }

  ClipType operation_;
  Clipper2Lib::Clipper64 clipper_;
  Paths64 found_, column_subjects_, column_clips_;
  std::vector<Item> items_;
  std::vector<std::size_t> next_column_;  // first item of the column after the one that starts here
};

NewRings combine(ClipType operation, const Rings& a, const Rings& b) {
  NewRings result;
  result.xy.reserve(2 * a.n_points());
  Combination combination(operation);
  Paths64 subjects, clips;
  for (std::size_t i = 0, k = 0; i < a.size() || k < b.size();) {
    const bool a_first = k == b.size() || (i < a.size() && a.layer(i) <= b.layer(k));
    const std::int64_t layer = a_first ? a.layer(i) : b.layer(k);
    subjects.clear();
    clips.clear();
    for (; i < a.size() && a.layer(i) == layer; ++i) subjects.push_back(a.on_grid(i));
    for (; k < b.size() && b.layer(k) == layer; ++k) clips.push_back(b.on_grid(k));
    combination.combine(subjects, clips, layer, &result);
  }
  return result;
}

}  // namespace

PyObject* combine_areas(PyObject*, PyObject* arguments) {
  int operation;
  PyObject* arrays[6];
  if (!PyArg_ParseTuple(arguments, "iOOOOOO:combine_areas", &operation, &arrays[0], &arrays[1], &arrays[2], &arrays[3],
                        &arrays[4], &arrays[5]))
    return nullptr;
  const Numbers a_xy(arrays[0]), a_start(arrays[1]), a_layer(arrays[2]);
  const Numbers b_xy(arrays[3]), b_start(arrays[4]), b_layer(arrays[5]);
  for (const Numbers* numbers : {&a_xy, &a_start, &a_layer, &b_xy, &b_start, &b_layer})
    if (!numbers->valid()) return nullptr;
  NewRings result;
  const bool succeeded = run([&] {
    if (operation < 0 || operation > 2) throw Invalid{"unknown operation"};
    result = combine(OPERATIONS[operation], Rings(a_xy, a_start, a_layer), Rings(b_xy, b_start, b_layer));
  });
  return succeeded ? to_tuple(std::move(result.xy), std::move(result.start), std::move(result.layer)) : nullptr;
}
