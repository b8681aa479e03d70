// The nearest marked item along links; the twin is `_find_nearest_changes` in printer_slicer/perimeters/layout.py.

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "functions.hpp"

namespace {

constexpr double TOLERANCE = 1e-9;  // mm; a way must be so much shorter to be preferred

struct Nearest {
  std::vector<std::int64_t> item;  // -1 if none is within reach
  std::vector<double> distance;
};

// In each round, ways grow by one link from the items that changed in the round before. Of several ways to an item, the
// shortest counts, and of equal ones the last; `link` holds two items for each link.
Nearest find(const std::int64_t* link, const double* length, std::size_t n_links, const std::int64_t* marked,
             std::size_t n, double reach) {
  Nearest result{std::vector<std::int64_t>(n, -1),
                 std::vector<double>(n, std::numeric_limits<double>::infinity())};
  std::vector<char> is_new(n);
  for (std::size_t i = 0; i < n; ++i) {
    if (!marked[i]) continue;
    result.item[i] = static_cast<std::int64_t>(i);
    result.distance[i] = 0.0;
    is_new[i] = 1;
  }
  std::vector<double> best(n, std::numeric_limits<double>::infinity());
  std::vector<std::int64_t> from(n), reached;
  do {
    reached.clear();
    for (int direction = 0; direction < 2; ++direction) {
      for (std::size_t k = 0; k < n_links; ++k) {
        const std::int64_t a = link[2 * k + direction], b = link[2 * k + 1 - direction];
        if (!is_new[a] || !(length[k] <= reach)) continue;
        const double distance = result.distance[a] + length[k];
        if (!(distance < result.distance[b] - TOLERANCE && distance <= reach) || distance > best[b]) continue;
        if (best[b] == std::numeric_limits<double>::infinity()) reached.push_back(b);
        best[b] = distance;
        from[b] = result.item[a];
      }
    }
    is_new.assign(n, 0);
    for (const std::int64_t b : reached) {
      result.distance[b] = best[b];
      result.item[b] = from[b];
      best[b] = std::numeric_limits<double>::infinity();
      is_new[b] = 1;
    }
  } while (!reached.empty());
  return result;
}

}  // namespace

PyObject* nearest_marked(PyObject*, PyObject* arguments) {
  PyObject *links_object, *lengths_object, *marked_object;
  double reach;
  if (!PyArg_ParseTuple(arguments, "OOOd:nearest_marked", &links_object, &lengths_object, &marked_object, &reach))
    return nullptr;
  Numbers links(links_object);
  if (!links.valid()) return nullptr;
  Numbers lengths(lengths_object);
  if (!lengths.valid()) return nullptr;
  Numbers marked(marked_object);
  if (!marked.valid()) return nullptr;
  Nearest result;
  const bool succeeded = run([&] {
    if (!links.is_whole() || !lengths.is_whole() || !marked.is_whole() || links.size() != 2 * lengths.size())
      throw Invalid{"the numbers of links and lengths do not match"};
    for (std::size_t i = 0; i < links.size(); ++i)
      if (links.data()[i] < 0 || static_cast<std::size_t>(links.data()[i]) >= marked.size())
        throw Invalid{"a link has an item that does not exist"};
    for (std::size_t k = 0; k < lengths.size(); ++k)
      if (lengths.doubles()[k] < 0) throw Invalid{"a length is negative"};
    result = find(links.data(), lengths.doubles(), lengths.size(), marked.data(), marked.size(), reach);
  });
  return succeeded ? to_tuple(result.item, result.distance) : nullptr;
}
