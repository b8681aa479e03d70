// Pairs of boxes that overlap; the twin is in printer_slicer/geometry/boxes.py.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
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

// Intervals along the first axis, and the order in which they begin.
struct Spans {
  std::vector<double> low, high, begin;
  std::vector<std::size_t> order;

  Spans(const Boxes& boxes, double pitch) : low(boxes.count), high(boxes.count), begin(boxes.count), order(boxes.count) {
    for (std::size_t i = 0; i < boxes.count; ++i) {
      const double shift = static_cast<double>(boxes.layer[i]) * pitch;
      low[i] = boxes.low[i].x + shift;
      high[i] = boxes.high[i].x + shift;
    }
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return low[a] != low[b] ? low[a] < low[b] : a < b; });
    for (std::size_t i = 0; i < boxes.count; ++i) begin[i] = low[order[i]];
  }
};

bool meet_in_y(const Boxes& boxes, std::size_t i, const Boxes& others, std::size_t j) {
  return boxes.low[i].y <= others.high[j].y && others.low[j].y <= boxes.high[i].y;
}

// Calls visit(i, j) for each other interval j that begins within interval i; with `ties`, also where i begins.
template <typename Visit>
void visit_begins_within(const Spans& spans, const Spans& others, bool ties, const Visit& visit) {
  const auto first = others.begin.begin(), last = others.begin.end();
  for (std::size_t i = 0; i < spans.low.size(); ++i) {
    auto found = ties ? std::lower_bound(first, last, spans.low[i]) : std::upper_bound(first, last, spans.low[i]);
    for (; found != last && *found <= spans.high[i]; ++found)
      visit(i, others.order[static_cast<std::size_t>(found - first)]);
  }
}

struct Pairs {
  std::vector<std::int64_t> one, other;

  void append(std::size_t a, std::size_t b) {
    one.push_back(static_cast<std::int64_t>(a));
    other.push_back(static_cast<std::int64_t>(b));
  }
};

// If two intervals overlap, one of them begins within the other.
Pairs find_overlapping(const Boxes& own, const Boxes& others) {
  Pitch pitch;
  pitch.include(own);
  pitch.include(others);
  const Spans own_spans(own, pitch.value()), other_spans(others, pitch.value());
  Pairs pairs;
  visit_begins_within(own_spans, other_spans, true, [&](std::size_t i, std::size_t j) {
    if (meet_in_y(own, i, others, j)) pairs.append(i, j);
  });
  visit_begins_within(other_spans, own_spans, false, [&](std::size_t j, std::size_t i) {
    if (meet_in_y(own, i, others, j)) pairs.append(i, j);
  });
  return pairs;
}

Pairs find_neighbours(const Boxes& boxes) {
  Pitch pitch;
  pitch.include(boxes);
  const Spans spans(boxes, pitch.value());
  Pairs pairs;
  visit_begins_within(spans, spans, true, [&](std::size_t i, std::size_t j) {
    if ((spans.low[j] > spans.low[i] || j > i) && meet_in_y(boxes, i, boxes, j)) pairs.append(i, j);
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
  return succeeded ? to_tuple(pairs.one, pairs.other) : nullptr;
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
  return succeeded ? to_tuple(pairs.one, pairs.other) : nullptr;
}
