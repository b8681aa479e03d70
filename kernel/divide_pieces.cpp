// Division of the pieces of a medial axis; the twin is `_divide` in printer_slicer/perimeters/graph.py.

#include <cstddef>
#include <cstdint>
#include <vector>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

// Two half-pieces per piece, in opposite directions: where they start, their two feet, and what follows them.
struct Pieces {
  const std::int64_t *start, *following;
  const Point* foot;
  std::size_t count;
};

// Positions from 0 to 1 on pieces, ascending.
struct Cuts {
  const std::int64_t* piece;
  const double* share;
  std::size_t count;
};

struct Parts {
  std::vector<std::int64_t> start, following, owner;
  std::vector<Point> foot;
};

// Returns the first part of each piece, and the number of parts.
std::vector<std::int64_t> number_parts(const Cuts& cuts, std::size_t n_pieces) {
  std::vector<std::int64_t> first(n_pieces + 1);
  std::size_t cut = 0;
  for (std::size_t piece = 0; piece < n_pieces; ++piece) {
    first[piece] = static_cast<std::int64_t>(piece + cut);
    while (cut < cuts.count && cuts.piece[cut] == static_cast<std::int64_t>(piece)) ++cut;
  }
  if (cut < cuts.count) throw Invalid{"the cuts are not in the order of pieces"};
  first[n_pieces] = static_cast<std::int64_t>(n_pieces + cut);
  return first;
}

// Cut `i` becomes point `n_points + i`.
Parts divide(const Pieces& pieces, const Cuts& cuts, std::int64_t n_points) {
  const std::vector<std::int64_t> first = number_parts(cuts, pieces.count);
  const auto entry = [&](std::int64_t half) {
    return half < 0 ? -1 : half % 2 ? 2 * first[half / 2 + 1] - 1 : 2 * first[half / 2];
  };
  Parts result;
  const std::size_t n_parts = static_cast<std::size_t>(first.back());
  result.start.reserve(2 * n_parts);
  result.following.reserve(2 * n_parts);
  result.owner.reserve(n_parts);
  result.foot.reserve(4 * n_parts);
  std::size_t cut = 0;
  for (std::size_t piece = 0; piece < pieces.count; ++piece) {
    const Point *up = pieces.foot + 4 * piece, *down = up + 2;
    for (std::int64_t part = first[piece]; part < first[piece + 1]; ++part) {
      const bool is_first = part == first[piece], is_last = part + 1 == first[piece + 1];
      const double low = is_first ? 0.0 : cuts.share[cut - 1], high = is_last ? 1.0 : cuts.share[cut];
      const std::int64_t new_point = n_points + static_cast<std::int64_t>(cut);
      result.owner.push_back(static_cast<std::int64_t>(piece));
      result.start.push_back(is_first ? pieces.start[2 * piece] : new_point - 1);
      result.start.push_back(is_last ? pieces.start[2 * piece + 1] : new_point);
      result.following.push_back(is_last ? entry(pieces.following[2 * piece]) : 2 * part + 2);
      result.following.push_back(is_first ? entry(pieces.following[2 * piece + 1]) : 2 * part - 1);
      result.foot.push_back(up[0] + low * (up[1] - up[0]));
      result.foot.push_back(up[0] + high * (up[1] - up[0]));
      result.foot.push_back(down[0] + (1 - high) * (down[1] - down[0]));
      result.foot.push_back(down[0] + (1 - low) * (down[1] - down[0]));
      if (!is_last) ++cut;
    }
  }
  return result;
}

Parts divide(const Numbers& start, const Numbers& foot, const Numbers& following, const Numbers& piece,
             const Numbers& share, std::int64_t n_points) {
  const std::size_t n = start.size();
  for (const Numbers* numbers : {&start, &foot, &following, &piece, &share})
    if (!numbers->is_whole()) throw Invalid{"the arrays do not match"};
  if (n % 2 || foot.size() != 4 * n || following.size() != n || piece.size() != share.size())
    throw Invalid{"the arrays do not match"};
  for (std::size_t half = 0; half < n; ++half)
    if (following.data()[half] >= static_cast<std::int64_t>(n)) throw Invalid{"a half-piece does not exist"};
  return divide(Pieces{start.data(), following.data(), reinterpret_cast<const Point*>(foot.doubles()), n / 2},
                Cuts{piece.data(), share.doubles(), piece.size()}, n_points);
}

}  // namespace

PyObject* divide_pieces(PyObject*, PyObject* arguments) {
  PyObject *start_object, *foot_object, *following_object, *piece_object, *share_object;
  long long n_points;
  if (!PyArg_ParseTuple(arguments, "LOOOOO:divide_pieces", &n_points, &start_object, &foot_object, &following_object,
                        &piece_object, &share_object))
    return nullptr;
  Numbers start(start_object);
  if (!start.valid()) return nullptr;
  Numbers foot(foot_object);
  if (!foot.valid()) return nullptr;
  Numbers following(following_object);
  if (!following.valid()) return nullptr;
  Numbers piece(piece_object);
  if (!piece.valid()) return nullptr;
  Numbers share(share_object);
  if (!share.valid()) return nullptr;
  Parts result;
  const bool succeeded = run([&] { result = divide(start, foot, following, piece, share, n_points); });
  return succeeded ? to_tuple(result.start, result.foot, result.following, result.owner) : nullptr;
}
