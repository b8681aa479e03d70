// Facets, edges and corners that a ball on the surface can touch. The twin is in printer_slicer/surface/contacts.py.

#include <cmath>
#include <limits>
#include <utility>

#include "functions.hpp"
#include "keys.hpp"

namespace {

constexpr double LEVEL = 1e-9, NO_AREA = 1e-12;  // as in contacts.py
constexpr double TINY = 1e-300;                  // avoids division by 0

using Keys = std::vector<std::uint64_t>;
using Mask = std::vector<char>;

// Candidates as in contacts.py.
struct Candidates {
  std::vector<std::int64_t> place;
  Keys key, refused;
};

// The facets of a block: columns as in contacts.py, of which item c * n + f belongs to corner c of facet f.
struct Block {
  std::size_t n;
  std::vector<double> low, high, rise, size;
  Keys corner, edge;
  Mask steeper;            // edges
  Mask refused_edges[2];   // from above, and from below
  Mask refused_corners[2];
};

void read_facet(const double (*corners)[3], std::size_t f, Block* block) {
  double run[3], across[3], climb[3], level[3], length[3];
  for (int c = 0; c < 3; ++c) {
    const double *one = corners[c], *next = corners[(c + 1) % 3];
    run[c] = next[0] - one[0];
    across[c] = next[1] - one[1];
    climb[c] = next[2] - one[2];
    level[c] = std::sqrt(run[c] * run[c] + across[c] * across[c]);
    length[c] = std::sqrt(level[c] * level[c] + climb[c] * climb[c]);
    level[c] /= std::max(length[c], TINY);
  }
  const double x = across[0] * climb[1] - climb[0] * across[1], y = climb[0] * run[1] - run[0] * climb[1];
  const double z = run[0] * across[1] - across[0] * run[1], size = std::sqrt(x * x + y * y + z * z);
  const double longest = std::max({length[0], length[1], length[2]});
  const bool solid = size > NO_AREA * (longest * longest);
  const double rise = solid ? std::fabs(z) / std::max(size, TINY) : std::max({level[0], level[1], level[2]});
  block->low[f] = std::min({corners[0][2], corners[1][2], corners[2][2]});
  block->high[f] = std::max({corners[0][2], corners[1][2], corners[2][2]});
  block->rise[f] = rise;
  block->size[f] = size;
  for (int c = 0; c < 3; ++c) {
    const std::size_t i = c * block->n + f;
    const double inward = x * across[c] - y * run[c];
    const double slack = solid ? LEVEL * size * length[c] : std::numeric_limits<double>::infinity();
    block->steeper[i] = level[c] > rise + LEVEL && length[c] > 0;
    block->refused_edges[0][i] = inward > slack;
    block->refused_edges[1][i] = inward < -slack;
    block->corner[i] = keys::key_of({corners[c][0], corners[c][1], corners[c][2]});
  }
  for (int c = 0; c < 3; ++c) {
    const std::size_t i = c * block->n + f;
    block->edge[i] = keys::edge_key(block->corner[i], block->corner[(c + 1) % 3 * block->n + f]);
    for (int step = 1; step <= 2; ++step) {
      const int other = (c + step) % 3;
      if (block->corner[other * block->n + f] == block->corner[i]) continue;
      block->refused_corners[0][i] |= corners[other][2] >= corners[c][2];
      block->refused_corners[1][i] |= corners[other][2] <= corners[c][2];
    }
  }
}

Block read_block(const double* triangles, std::size_t n) {
  Block block{n, {}, {}, {}, {}, {}, {}, {}, {}, {}};
  for (auto* column : {&block.low, &block.high, &block.rise, &block.size}) column->resize(n);
  for (auto* column : {&block.corner, &block.edge}) column->resize(3 * n);
  block.steeper.resize(3 * n);
  for (int side = 0; side < 2; ++side) {
    block.refused_edges[side].resize(3 * n);
    block.refused_corners[side].resize(3 * n);
  }
  for (std::size_t f = 0; f < n; ++f) read_facet(reinterpret_cast<const double(*)[3]>(triangles + 9 * f), f, &block);
  return block;
}

// Selects from items that stand for edges or corners, with equal keys for the same one.
class Selection {
 public:
  Selection(const Keys& key, std::size_t n, std::int64_t begin, bool shared_by_two)
      : key_(key), n_(n), begin_(begin), welded_(keys::weld(key.data(), key.size())), alone_(welded_.last.size(), 1) {
    if (!shared_by_two) return;
    std::vector<std::int32_t> count(alone_.size());
    for (const std::int32_t number : welded_.number) ++count[number];
    for (std::size_t i = 0; i < count.size(); ++i) alone_[i] = count[i] == 1;
  }

  // Returns one item per key.
  const std::vector<std::int32_t>& last() const { return welded_.last; }

  Candidates select(const std::vector<std::int32_t>& items, const Mask& refused) const {
    Mask is_refused(alone_.size());
    for (std::size_t i = 0; i < refused.size(); ++i) is_refused[welded_.number[i]] |= refused[i];
    Candidates result;
    for (const std::int32_t item : items) {
      if (is_refused[welded_.number[item]]) continue;
      const auto i = static_cast<std::size_t>(item);
      result.place.push_back(3 * (begin_ + static_cast<std::int64_t>(i % n_)) + static_cast<std::int64_t>(i / n_));
      result.key.push_back(key_[i]);
    }
    for (std::size_t i = 0; i < is_refused.size(); ++i)
      if (is_refused[i] && alone_[i]) result.refused.push_back(key_[welded_.last[i]]);
    return result;
  }

 private:
  const Keys& key_;
  std::size_t n_;
  std::int64_t begin_;
  keys::Welded welded_;
  Mask alone_;  // keys that other blocks may contain, too
};

std::vector<std::int32_t> items_of(const Mask& mask) {
  std::vector<std::int32_t> result;
  for (std::size_t i = 0; i < mask.size(); ++i)
    if (mask[i]) result.push_back(static_cast<std::int32_t>(i));
  return result;
}

}  // namespace

PyObject* facet_contacts(PyObject*, PyObject* arguments) {
  PyObject* triangles_object;
  long long begin;
  if (!PyArg_ParseTuple(arguments, "OL:facet_contacts", &triangles_object, &begin)) return nullptr;
  const Numbers triangles(triangles_object);
  if (!triangles.valid()) return nullptr;
  Block block;
  Candidates edges[2], corners[2];
  const bool succeeded = run([&] {
    if (!triangles.is_whole() || triangles.size() % 9) throw Invalid{"a facet does not have nine coordinates"};
    if (triangles.size() / 3 > std::numeric_limits<std::int32_t>::max()) throw Invalid{"there are too many facets"};
    block = read_block(triangles.doubles(), triangles.size() / 9);
    const Selection of_edges(block.edge, block.n, begin, true), of_corners(block.corner, block.n, begin, false);
    const std::vector<std::int32_t> steeper = items_of(block.steeper);
    for (int side = 0; side < 2; ++side) {
      edges[side] = of_edges.select(steeper, block.refused_edges[side]);
      corners[side] = of_corners.select(of_corners.last(), block.refused_corners[side]);
    }
  });
  if (!succeeded) return nullptr;
  return to_tuple(block.low, block.high, block.rise, block.size, edges[0].place, edges[0].key, edges[0].refused,
                  edges[1].place, edges[1].key, edges[1].refused, corners[0].place, corners[0].key, corners[0].refused,
                  corners[1].place, corners[1].key, corners[1].refused);
}
