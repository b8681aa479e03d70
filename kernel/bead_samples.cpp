// Which samples of beads lie on beads of the layer below; the twin is `find_carried` in
// printer_slicer/supports/bead_samples.py.

#include <algorithm>
#include <cmath>

#include "functions.hpp"

namespace {

// As in bead_samples.py.
constexpr float SIDE = 1.0 / 3.0;  // widths from the middle of a bead to the points that stand for its sides

enum Kind : char { SKIPPED, ON_BED, OVER_LAYER, OVER_GAP };

struct Samples {
  const float *x, *y, *across;  // `across` holds two numbers for each bead
  const std::int64_t *bead, *layer_start;
  const char* kind;
  std::size_t n_layers;
};

class Raster {
 public:
  Raster(std::int64_t n_rows, std::int64_t n_columns)
      : n_rows_(n_rows), n_columns_(n_columns), covered_(static_cast<std::size_t>(n_rows * n_columns)) {}

  // Marks the cells whose middles are within half a width of a sample.
  void mark(const Samples& samples, std::int64_t i) {
    const double x = samples.x[i], y = samples.y[i];
    const double left = samples.across[2 * samples.bead[i]], up = samples.across[2 * samples.bead[i] + 1];
    const double square = (left * left + up * up) / 4.0, radius = std::sqrt(square);
    const auto low = static_cast<std::int64_t>(std::ceil(y - radius - 0.5));
    const auto high = static_cast<std::int64_t>(std::floor(y + radius - 0.5));
    for (std::int64_t row = std::max<std::int64_t>(low, 0); row <= std::min(high, n_rows_ - 1); ++row) {
      const double rise = static_cast<double>(row) + 0.5 - y;
      const double half = std::sqrt(std::max(square - rise * rise, 0.0));
      const auto first = std::max<std::int64_t>(static_cast<std::int64_t>(std::ceil(x - half - 0.5)), 0);
      const auto last = std::min(static_cast<std::int64_t>(std::floor(x + half - 0.5)), n_columns_ - 1);
      if (last < first) continue;
      const std::int64_t begin = row * n_columns_ + first, end = row * n_columns_ + last + 1;
      std::fill(covered_.begin() + begin, covered_.begin() + end, char{1});
      marked_.push_back(begin);
      marked_.push_back(end);
    }
  }

  void clear() {
    for (std::size_t k = 0; k < marked_.size(); k += 2)
      std::fill(covered_.begin() + marked_[k], covered_.begin() + marked_[k + 1], char{0});
    marked_.clear();
  }

  // Whether a sample lies on what is marked with half of its width, or with both sides.
  bool carries(const Samples& samples, std::int64_t i) const {
    const float x = samples.x[i], y = samples.y[i];
    const float left = samples.across[2 * samples.bead[i]], up = samples.across[2 * samples.bead[i] + 1];
    const auto holds_at = [&](float aside) { return holds(x + aside * left, y + aside * up); };
    return holds(x, y) || (holds_at(-SIDE) && holds_at(SIDE));
  }

 private:
  bool holds(float x, float y) const {
    if (!(x >= 0.0f && y >= 0.0f)) return false;
    const auto column = static_cast<std::int64_t>(x), row = static_cast<std::int64_t>(y);
    return row < n_rows_ && column < n_columns_ && covered_[static_cast<std::size_t>(row * n_columns_ + column)];
  }

  std::int64_t n_rows_, n_columns_;
  std::vector<char> covered_;
  std::vector<std::int64_t> marked_;
};

std::vector<char> find(const Samples& samples, std::size_t n, std::int64_t n_rows, std::int64_t n_columns) {
  std::vector<char> carried(n);
  Raster raster(n_rows, n_columns);
  for (std::size_t layer = 0; layer < samples.n_layers; ++layer) {
    const char kind = samples.kind[layer];
    if (kind == SKIPPED) continue;
    const std::int64_t first = samples.layer_start[layer], last = samples.layer_start[layer + 1];
    for (std::int64_t i = first; i < last; ++i)
      carried[static_cast<std::size_t>(i)] = kind == ON_BED || (kind == OVER_LAYER && raster.carries(samples, i));
    raster.clear();
    for (std::int64_t i = first; i < last; ++i) raster.mark(samples, i);
  }
  return carried;
}

}  // namespace

PyObject* find_carried_samples(PyObject*, PyObject* arguments) {
  PyObject* objects[6];
  long long n_rows, n_columns;
  if (!PyArg_ParseTuple(arguments, "(OOOO)OO(LL):find_carried_samples", &objects[0], &objects[1], &objects[2],
                        &objects[3], &objects[4], &objects[5], &n_rows, &n_columns))
    return nullptr;
  const Elements<const float> x(objects[0]), y(objects[1]), across(objects[2]);
  const Numbers bead(objects[3]), layer_start(objects[4]);
  const Elements<const char> kind(objects[5]);
  if (PyErr_Occurred()) return nullptr;
  std::vector<char> carried;
  const bool succeeded = run([&] {
    const std::size_t n = x.size(), n_layers = kind.size();
    if (!x.is_whole() || !y.is_whole() || !across.is_whole() || !bead.is_whole() || !layer_start.is_whole() ||
        y.size() != n || bead.size() != n || layer_start.size() != n_layers + 1 || across.size() % 2)
      throw Invalid{"the arrays of samples do not match"};
    if (n_rows < 1 || n_columns < 1 || n_rows > (1LL << 40) / n_columns) throw Invalid{"the grid has no such size"};
    for (std::size_t i = 0; i < n; ++i)
      if (bead.data()[i] < 0 || static_cast<std::size_t>(bead.data()[i]) >= across.size() / 2)
        throw Invalid{"a sample has a bead that does not exist"};
    for (std::size_t layer = 0; layer < n_layers; ++layer)
      if (layer_start.data()[layer] < 0 || layer_start.data()[layer] > layer_start.data()[layer + 1] ||
          static_cast<std::size_t>(layer_start.data()[layer + 1]) > n)
        throw Invalid{"a layer has samples that do not exist"};
    const Samples samples{x.data(), y.data(), across.data(), bead.data(), layer_start.data(), kind.data(), n_layers};
    carried = find(samples, n, n_rows, n_columns);
  });
  return succeeded ? to_bytes(std::move(carried)) : nullptr;
}
