// Keys of corners and edges, and numbers of equal keys. The twins are in printer_slicer/geometry: connectivity.py and
// facet_topology.py.

#ifndef PRINTER_SLICER_KEYS
#define PRINTER_SLICER_KEYS

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace keys {

// As in connectivity.py and facet_topology.py.
constexpr std::uint64_t SPREAD = 0x9E3779B97F4A7C15;
constexpr std::uint64_t FACTORS[] = {0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93};

struct Welded {
  std::vector<std::int32_t> number, last;
};

// Numbers equal keys alike, by the last position of each key.
inline Welded weld(const std::uint64_t* key, std::size_t n) {
  int bits = 4;
  while ((std::size_t{1} << bits) < 2 * n) ++bits;
  const std::size_t mask = (std::size_t{1} << bits) - 1;
  std::vector<std::int32_t> table(mask + 1, -1), last;  // groups by hash, and the last position so far of each
  Welded result{std::vector<std::int32_t>(n), {}};
  for (std::size_t i = 0; i < n; ++i) {
    std::size_t slot = (key[i] * SPREAD) >> (64 - bits);
    while (table[slot] >= 0 && key[last[table[slot]]] != key[i]) slot = (slot + 1) & mask;
    if (table[slot] < 0) {
      table[slot] = static_cast<std::int32_t>(last.size());
      last.push_back(0);
    }
    last[table[slot]] = static_cast<std::int32_t>(i);
    result.number[i] = table[slot];
  }
  std::vector<std::int32_t> rank(last.size());
  result.last.reserve(last.size());
  for (std::size_t i = 0; i < n; ++i) {
    const std::int32_t group = result.number[i];
    if (static_cast<std::size_t>(last[group]) != i) continue;
    rank[group] = static_cast<std::int32_t>(result.last.size());
    result.last.push_back(static_cast<std::int32_t>(i));
  }
  for (std::int32_t& number : result.number) number = rank[number];
  return result;
}

inline std::uint64_t key_of(const double (&coordinates)[3]) {
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double value = coordinates[axis] + 0.0;  // turns -0.0 into 0.0
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    key ^= bits << 23;
    key ^= bits >> 41;
    key *= FACTORS[axis];
    key ^= key >> 29;
  }
  key *= FACTORS[3];
  return key ^ (key >> 32);
}

// Returns the key of an edge between two corners; both directions have the same one.
inline std::uint64_t edge_key(std::uint64_t one, std::uint64_t other) {
  const std::uint64_t key = (std::min(one, other) * FACTORS[3]) ^ std::max(one, other);
  return (key ^ (key >> 32)) * FACTORS[3];
}

}  // namespace keys

#endif
