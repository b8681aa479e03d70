// Keys of corners, numbers of equal keys, connected components, and edges of facets. The twins are in printer_slicer:
// geometry/connectivity.py, geometry/facet_topology.py and healing/soundness.py.

#include "keys.hpp"

#include <limits>
#include <numeric>

#include "functions.hpp"

namespace {

// Returns the component of each item, numbered by the lowest item. Source: Galler and Fischer 1964, "An improved
// equivalence algorithm", with the lowest item as root.
std::vector<std::int64_t> label(const std::int32_t* one, const std::int32_t* other, std::size_t n_links, std::size_t n) {
  std::vector<std::int32_t> parent(n);
  std::iota(parent.begin(), parent.end(), 0);
  const auto root_of = [&](std::int32_t item) {
    while (parent[item] != item) item = parent[item] = parent[parent[item]];
    return item;
  };
  for (std::size_t i = 0; i < n_links; ++i) {
    const std::int32_t a = root_of(one[i]), b = root_of(other[i]);
    parent[std::max(a, b)] = std::min(a, b);
  }
  std::vector<std::int64_t> result(n);
  std::int64_t count = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const std::int32_t above = parent[i];  // a lower item, which has its number already
    result[i] = static_cast<std::size_t>(above) == i ? count++ : result[above];
  }
  return result;
}

// An edge between facets.
struct Edge {
  std::uint64_t key;
  std::int32_t up, down;  // the last facet that uses it towards the corner with the higher key, and away from it
  std::int32_t count, n_up;
};

// Edges of a block of facets without a partner in the block, as `_Edges` in soundness.py.
struct Unmatched {
  std::vector<std::uint64_t> key;
  std::vector<std::uint8_t> upward;
  std::vector<std::int32_t> piece;
  std::vector<std::int64_t> n_pieces;
};

// Returns the number of the edge at each corner, and appends the edges; tag has the keys of the corners of n facets.
std::vector<std::int32_t> number_edges(const std::vector<std::uint64_t>& tag, std::size_t n, std::vector<Edge>* edges) {
  int bits = 4;
  while ((std::size_t{1} << bits) < 6 * n) ++bits;
  const std::size_t mask = (std::size_t{1} << bits) - 1;
  std::vector<std::int32_t> table(mask + 1, -1), result(3 * n);
  edges->reserve(2 * n);
  for (std::size_t i = 0; i < 3 * n; ++i) {
    const std::uint64_t one = tag[i], other = tag[i < 2 * n ? i + n : i - 2 * n];
    const std::uint64_t key = keys::edge_key(one, other);
    std::size_t slot = (key * keys::SPREAD) >> (64 - bits);
    while (table[slot] >= 0 && (*edges)[table[slot]].key != key) slot = (slot + 1) & mask;
    if (table[slot] < 0) {
      table[slot] = static_cast<std::int32_t>(edges->size());
      edges->push_back({key, 0, 0, 0, 0});
    }
    result[i] = table[slot];
    Edge& edge = (*edges)[table[slot]];
    (one < other ? edge.up : edge.down) = static_cast<std::int32_t>(i % n);
    ++edge.count;
    edge.n_up += one < other;
  }
  return result;
}

Unmatched match(const std::vector<std::uint64_t>& tag, std::size_t n) {
  std::vector<Edge> edges;
  const std::vector<std::int32_t> number = number_edges(tag, n, &edges);
  std::vector<std::int32_t> one, other;
  const auto is_joined = [](const Edge& edge) { return edge.count == 2 && edge.n_up == 1; };
  for (const Edge& edge : edges)
    if (is_joined(edge)) {
      one.push_back(edge.up);
      other.push_back(edge.down);
    }
  const std::vector<std::int64_t> piece = label(one.data(), other.data(), one.size(), n);
  Unmatched result;
  for (std::size_t i = 0; i < 3 * n; ++i) {
    const Edge& edge = edges[number[i]];
    if (is_joined(edge)) continue;
    result.key.push_back(edge.key);
    result.upward.push_back(tag[i] < tag[i < 2 * n ? i + n : i - 2 * n]);
    result.piece.push_back(static_cast<std::int32_t>(piece[i % n]));
  }
  result.n_pieces.push_back(n ? *std::max_element(piece.begin(), piece.end()) + 1 : 0);
  return result;
}

}  // namespace

PyObject* coordinate_keys(PyObject*, PyObject* arguments) {
  PyObject* objects[3];
  if (!PyArg_ParseTuple(arguments, "OOO:coordinate_keys", &objects[0], &objects[1], &objects[2])) return nullptr;
  const Numbers x(objects[0]), y(objects[1]), z(objects[2]);
  if (!z.valid()) return nullptr;
  std::vector<std::uint64_t> result;
  const bool succeeded = run([&] {
    if (!x.is_whole() || !y.is_whole() || !z.is_whole() || x.size() != y.size() || y.size() != z.size())
      throw Invalid{"the coordinates do not match"};
    result.reserve(x.size());
    for (std::size_t i = 0; i < x.size(); ++i)
      result.push_back(keys::key_of({x.doubles()[i], y.doubles()[i], z.doubles()[i]}));
  });
  return succeeded ? to_bytes(result) : nullptr;
}

PyObject* label_components(PyObject*, PyObject* arguments) {
  PyObject *one_object, *other_object;
  Py_ssize_t n;
  if (!PyArg_ParseTuple(arguments, "OOn:label_components", &one_object, &other_object, &n)) return nullptr;
  const Elements<const std::int32_t> one(one_object), other(other_object);
  if (!other.valid()) return nullptr;
  std::vector<std::int64_t> result;
  const bool succeeded = run([&] {
    if (!one.is_whole() || !other.is_whole() || one.size() != other.size()) throw Invalid{"the links do not match"};
    if (n < 0 || n > std::numeric_limits<std::int32_t>::max()) throw Invalid{"there are too many items"};
    for (const auto* items : {&one, &other})
      for (std::size_t i = 0; i < items->size(); ++i)
        if (items->data()[i] < 0 || items->data()[i] >= n) throw Invalid{"a link has an item that does not exist"};
    result = label(one.data(), other.data(), one.size(), static_cast<std::size_t>(n));
  });
  return succeeded ? to_bytes(result) : nullptr;
}

PyObject* match_edges(PyObject*, PyObject* arguments) {
  PyObject* objects[3];
  if (!PyArg_ParseTuple(arguments, "OOO:match_edges", &objects[0], &objects[1], &objects[2])) return nullptr;
  const Numbers x(objects[0]), y(objects[1]), z(objects[2]);
  if (!z.valid()) return nullptr;
  Unmatched result;
  const bool succeeded = run([&] {
    if (!x.is_whole() || !y.is_whole() || !z.is_whole() || x.size() != y.size() || y.size() != z.size() || x.size() % 3)
      throw Invalid{"the coordinates do not match"};
    if (x.size() > std::numeric_limits<std::int32_t>::max()) throw Invalid{"there are too many facets"};
    std::vector<std::uint64_t> tag;
    tag.reserve(x.size());
    for (std::size_t i = 0; i < x.size(); ++i) tag.push_back(keys::key_of({x.doubles()[i], y.doubles()[i], z.doubles()[i]}));
    result = match(tag, x.size() / 3);
  });
  return succeeded ? to_tuple(result.key, result.upward, result.piece, result.n_pieces) : nullptr;
}

PyObject* weld_keys(PyObject*, PyObject* keys) {
  const Elements<const std::uint64_t> key(keys);
  if (!key.valid()) return nullptr;
  keys::Welded result;
  const bool succeeded = run([&] {
    if (!key.is_whole()) throw Invalid{"a key does not have 64 bits"};
    if (key.size() > std::numeric_limits<std::int32_t>::max()) throw Invalid{"there are too many keys"};
    result = keys::weld(key.data(), key.size());
  });
  return succeeded ? to_tuple(result.number, result.last) : nullptr;
}
