// Costs of the cheapest paths whose neighbouring layers have limits; the twin is in printer_slicer/shortest_path.py.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "functions.hpp"

namespace {

constexpr double NONE = std::numeric_limits<double>::infinity();

// The minimum over a window of columns for each column, by minima over runs of 1, 2, 4, ... columns.
class Windows {
 public:
  // Columns that do not exist are ignored; no window is empty.
  Windows(const std::int64_t* first, const std::int64_t* last, std::size_t n) : level_(n), left_(n), right_(n) {
    const auto most = static_cast<std::int64_t>(n) - 1;
    std::size_t levels = 1;
    for (std::size_t i = 0; i < n; ++i) {
      const std::int64_t low = std::max<std::int64_t>(first[i], 0), high = std::min(last[i], most);
      if (low > high) throw Invalid{"a window is empty"};
      const auto width = static_cast<std::size_t>(high - low + 1);
      while (std::size_t{2} << level_[i] <= width) ++level_[i];
      left_[i] = static_cast<std::size_t>(low);
      right_[i] = static_cast<std::size_t>(high) + 1 - (std::size_t{1} << level_[i]);
      levels = std::max(levels, level_[i] + 1);
    }
    runs_.assign(levels, std::vector<double>(n, NONE));
  }

  std::vector<double>& values() { return runs_[0]; }

  // Writes the smaller one of the minimum over each window and `most`.
  void write(double most, double* result) {
    const std::size_t n = level_.size();
    for (std::size_t level = 1; level < runs_.size(); ++level) {
      const std::size_t step = std::size_t{1} << (level - 1);
      for (std::size_t i = 0; i + step < n; ++i)
        runs_[level][i] = std::min(runs_[level - 1][i], runs_[level - 1][i + step]);
    }
    for (std::size_t i = 0; i < n; ++i) {
      const std::vector<double>& run = runs_[level_[i]];
      result[i] = std::min(std::min(run[left_[i]], run[right_[i]]), most);
    }
  }

 private:
  std::vector<std::size_t> level_, left_, right_;
  std::vector<std::vector<double>> runs_;
};

struct Graph {
  const Numbers &begin, &start, &cost, &first, &last, &spared;
  std::int64_t low;
  double penalty, reduced;

  std::size_t n_nodes() const { return spared.size(); }

  void check() const {
    for (const Numbers* numbers : {&begin, &start, &cost, &first, &last, &spared})
      if (!numbers->is_whole()) throw Invalid{"an array is not whole"};
    if (!n_nodes() || begin.size() != n_nodes() + 1 || start.size() != cost.size() || first.size() != last.size())
      throw Invalid{"the arrays of the graph do not match"};
    const std::int64_t* const arc = begin.data();
    if (arc[0] || arc[1] || static_cast<std::size_t>(arc[n_nodes()]) != start.size())
      throw Invalid{"the arcs do not match the nodes"};
    for (std::size_t node = 1; node < n_nodes(); ++node) {
      if (arc[node] > arc[node + 1]) throw Invalid{"the arcs do not match the nodes"};
      for (std::int64_t i = arc[node]; i < arc[node + 1]; ++i) {
        const std::int64_t from = start.data()[i], row = static_cast<std::int64_t>(node) - from - low;
        if (from < 0 || from >= static_cast<std::int64_t>(node) || row < 0 ||
            row >= static_cast<std::int64_t>(first.size()))
          throw Invalid{"an arc has a height without limits"};
      }
    }
  }

  // Computes `reach` (nodes, rows) and `anyhow` (nodes,) of `cheapest_with_neighbours`.
  void search(std::vector<double>* reach, std::vector<double>* anyhow) const {
    const std::size_t rows = first.size();
    Windows windows(first.data(), last.data(), rows);
    reach->assign(n_nodes() * rows, NONE);
    anyhow->assign(n_nodes(), NONE);
    std::fill_n(reach->begin(), rows, 0.0);
    (*anyhow)[0] = 0.0;
    std::vector<double>& total = windows.values();
    for (std::size_t node = 1; node < n_nodes(); ++node) {
      std::fill(total.begin(), total.end(), NONE);
      double least = NONE, beside = NONE;
      for (std::int64_t i = begin.data()[node]; i < begin.data()[node + 1]; ++i) {
        const auto from = static_cast<std::size_t>(start.data()[i]);
        const std::size_t row = node - from - static_cast<std::size_t>(low);
        double before = (*reach)[from * rows + row];
        if (spared.data()[node]) before = std::min(before, (*anyhow)[from] + reduced);
        const double value = before + cost.doubles()[i];
        total[row] = value;
        least = std::min(least, value);
        if (spared.data()[from]) beside = std::min(beside, value + reduced);
      }
      (*anyhow)[node] = least;
      const double other = least + (spared.data()[node] ? reduced : penalty);
      windows.write(std::min(other, beside), reach->data() + node * rows);
    }
  }
};

}  // namespace

PyObject* neighbour_paths(PyObject*, PyObject* arguments) {
  PyObject* arrays[6];
  long long low;
  double penalty, reduced;
  if (!PyArg_ParseTuple(arguments, "(OOO)(OOO)Ldd:neighbour_paths", &arrays[0], &arrays[1], &arrays[2], &arrays[3],
                        &arrays[4], &arrays[5], &low, &penalty, &reduced))
    return nullptr;
  const Numbers begin(arrays[0]), start(arrays[1]), cost(arrays[2]), first(arrays[3]), last(arrays[4]), spared(arrays[5]);
  for (const Numbers* numbers : {&begin, &start, &cost, &first, &last, &spared})
    if (!numbers->valid()) return nullptr;
  std::vector<double> reach, anyhow;
  const bool succeeded = run([&] {
    const Graph graph{begin, start, cost, first, last, spared, low, penalty, reduced};
    graph.check();
    graph.search(&reach, &anyhow);
  });
  return succeeded ? to_tuple(reach, anyhow) : nullptr;
}
