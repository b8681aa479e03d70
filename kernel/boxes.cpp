// Pairs of boxes that overlap; the twin is in printer_slicer/geometry/boxes.py.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

struct Boxes {
  const Point *low, *high;
  const std::int64_t* layer;
  std::size_t count;
};

// The three arrays of boxes: lowest and highest corners, and layers.
class BoxArrays {
 public:
  BoxArrays(PyObject* low, PyObject* high, PyObject* layer) : low_(low), high_(high), layer_(layer) {}

  bool valid() const { return low_.valid() && high_.valid() && layer_.valid(); }
  Boxes boxes() const {
    const std::size_t n = layer_.size();
    const bool are_whole = low_.is_whole() && high_.is_whole() && layer_.is_whole();
    if (!are_whole || low_.size() != 2 * n || high_.size() != 2 * n) throw Invalid{"the boxes do not match"};
    return {reinterpret_cast<const Point*>(low_.doubles()), reinterpret_cast<const Point*>(high_.doubles()),
            layer_.data(), n};
  }

 private:
  Numbers low_, high_, layer_;
};

// Finds the distance by which layers are moved apart along the first axis.
class Pitch {
 public:
  void include(const Boxes& boxes) {
    for (const Point* corner : {boxes.low, boxes.high}) {
      for (std::size_t i = 0; i < boxes.count; ++i) {
        if (!std::isfinite(corner[i].x)) continue;  // boxes without points have infinite corners
        least_ = std::min(least_, corner[i].x);
        most_ = std::max(most_, corner[i].x);
      }
    }
  }
  double value() const { return least_ <= most_ ? most_ - least_ + 1.0 : 1.0; }

 private:
  double least_ = std::numeric_limits<double>::infinity(), most_ = -least_;
};

// A box with its interval along the first axis after the layers are moved apart.
struct Span {
  double low, high, bottom, top;
  std::size_t box;
};

struct Spans {
  std::vector<Span> all, ordered;  // `ordered` by their begin
  std::vector<double> begin;       // of `ordered`

  Spans(const Boxes& boxes, double pitch) : begin(boxes.count) {
    all.reserve(boxes.count);
    for (std::size_t i = 0; i < boxes.count; ++i) {
      const double shift = static_cast<double>(boxes.layer[i]) * pitch;
      all.push_back({boxes.low[i].x + shift, boxes.high[i].x + shift, boxes.low[i].y, boxes.high[i].y, i});
    }
    ordered = all;
    std::sort(ordered.begin(), ordered.end(),
              [](const Span& a, const Span& b) { return a.low != b.low ? a.low < b.low : a.box < b.box; });
    for (std::size_t i = 0; i < boxes.count; ++i) begin[i] = ordered[i].low;
  }
};

// Calls visit(span, other) for others that begin within a span and overlap it along the second axis, too; with `ties`,
// also for those that begin where the span begins.
template <typename Visit>
void visit_begins_within(const Spans& spans, const Spans& others, bool ties, const Visit& visit) {
  const auto first = others.begin.begin(), last = others.begin.end();
  for (const Span& span : spans.all) {
    const auto found = ties ? std::lower_bound(first, last, span.low) : std::upper_bound(first, last, span.low);
    for (std::size_t k = static_cast<std::size_t>(found - first); k < others.begin.size(); ++k) {
      const Span& other = others.ordered[k];
      if (!(other.low <= span.high)) break;
      if (span.bottom <= other.top && other.bottom <= span.top) visit(span, other);
    }
  }
}

struct Pairs {
  std::vector<std::int64_t> one, other;

  void append(const Span& a, const Span& b) {
    one.push_back(static_cast<std::int64_t>(a.box));
    other.push_back(static_cast<std::int64_t>(b.box));
  }
};

// If two intervals overlap, one of them begins within the other.
Pairs find_overlapping(const Boxes& own, const Boxes& others) {
  Pitch pitch;
  pitch.include(own);
  pitch.include(others);
  const Spans own_spans(own, pitch.value()), other_spans(others, pitch.value());
  Pairs pairs;
  visit_begins_within(own_spans, other_spans, true, [&](const Span& a, const Span& b) { pairs.append(a, b); });
  visit_begins_within(other_spans, own_spans, false, [&](const Span& b, const Span& a) { pairs.append(a, b); });
  return pairs;
}

Pairs find_neighbours(const Boxes& boxes) {
  Pitch pitch;
  pitch.include(boxes);
  const Spans spans(boxes, pitch.value());
  Pairs pairs;
  visit_begins_within(spans, spans, true, [&](const Span& a, const Span& b) {
    if (b.low > a.low || b.box > a.box) pairs.append(a, b);
  });
  return pairs;
}

}  // namespace

PyObject* neighbouring_boxes(PyObject*, PyObject* arguments) {
  PyObject *low, *high, *layer;
  if (!PyArg_ParseTuple(arguments, "OOO:neighbouring_boxes", &low, &high, &layer)) return nullptr;
  const BoxArrays arrays(low, high, layer);
  if (!arrays.valid()) return nullptr;
  Pairs pairs;
  const bool succeeded = run([&] { pairs = find_neighbours(arrays.boxes()); });
  return succeeded ? to_tuple(std::move(pairs.one), std::move(pairs.other)) : nullptr;
}

PyObject* overlapping_boxes(PyObject*, PyObject* arguments) {
  PyObject *low, *high, *layer, *other_low, *other_high, *other_layer;
  if (!PyArg_ParseTuple(arguments, "OOOOOO:overlapping_boxes", &low, &high, &layer, &other_low, &other_high,
                        &other_layer))
    return nullptr;
  const BoxArrays arrays(low, high, layer);
  if (!arrays.valid()) return nullptr;
  const BoxArrays other_arrays(other_low, other_high, other_layer);
  if (!other_arrays.valid()) return nullptr;
  Pairs pairs;
  const bool succeeded = run([&] { pairs = find_overlapping(arrays.boxes(), other_arrays.boxes()); });
  return succeeded ? to_tuple(std::move(pairs.one), std::move(pairs.other)) : nullptr;
}
