// Moves on the height map of the plate. The twins are in printer_slicer/inspection/deposition: height_map.py and
// unsupported.py, which say what the steps are for.

#include <algorithm>
#include <cmath>
#include <optional>

#include "functions.hpp"
#include "vectors.hpp"

namespace {

// As in height_map.py and unsupported.py; mm unless said otherwise.
constexpr double PI = 3.141592653589793, CELL = 0.25, MAX_WIDTH = 2.0, NEGLIGIBLE = 1e-9, ROUNDING = 1e-4;
constexpr double MAX_FLATTENING = 3.0, SAME_HEIGHT = 0.02, MAX_SAG = 1.15, MIN_STRAIGHTNESS = 0.95;
constexpr std::int64_t SUPPORT_REACH = 1, MAX_OVERHANG = 20, MARGIN = 3;  // cells
constexpr double MOST_PIECES = 1e9;
constexpr std::int64_t MOST_CELLS = 1 << 30;

using Indices = std::vector<std::int64_t>;

struct Place {
  double x, y, z;
};

// The moves of one height, and the pieces into which they are split. Throws Invalid if the arrays do not match.
struct Level {
  Level(const Numbers (&moves)[4], const Elements<const char>& is_removable, const Numbers (&pieces)[6])
      : start(reinterpret_cast<const Place*>(moves[0].doubles())),
        end(reinterpret_cast<const Place*>(moves[1].doubles())), volume(moves[2].doubles()), xy_length(moves[3].doubles()), removable(is_removable.data()),
        n_moves(is_removable.size()), move(pieces[0].data()), x(pieces[1].doubles()), y(pieces[2].doubles()),
        z(pieces[3].doubles()), length(pieces[4].doubles()), cell(pieces[5].data()), n_pieces(pieces[0].size()) {
    for (int i = 0; i < 4; ++i)
      if (!moves[i].is_whole() || moves[i].size() != (i < 2 ? 3 : 1) * n_moves) throw Invalid{"the moves do not match"};
    for (const Numbers& numbers : pieces)
      if (!numbers.is_whole() || numbers.size() != n_pieces) throw Invalid{"the pieces do not match"};
    for (std::size_t i = 0; i < n_pieces; ++i)
      if (move[i] < 0 || static_cast<std::size_t>(move[i]) >= n_moves) throw Invalid{"a piece is of no move"};
  }

  double strand_diameter(std::size_t of) const {
    return 2.0 * std::sqrt(volume[of] / std::max(xy_length[of], NEGLIGIBLE) / PI);
  }

  const Place *start, *end;
  const double *volume, *xy_length;
  const char* removable;
  std::size_t n_moves;
  const std::int64_t* move;
  const double *x, *y, *z, *length;
  const std::int64_t* cell;
  std::size_t n_pieces;
};

// The top of the print in each cell, row by row; the last cell is everything outside. `Byte` is const char or char.
template <typename Height, typename Byte>
struct Map {
  Map(const Elements<Height>& top_, const Elements<Byte>& removable_, std::int64_t wide_, const Level& level)
      : top(top_.data()), removable(removable_.size() ? removable_.data() : nullptr), wide(wide_),
        outside(static_cast<std::int64_t>(top_.size()) - 1) {
    if (!top_.is_whole() || outside < 0 || wide < 1 || outside % wide) throw Invalid{"the height map has no such rows"};
    if (removable && removable_.size() != top_.size())
      throw Invalid{"the arrays of the height map do not match"};
    for (std::size_t i = 0; i < level.n_pieces; ++i)
      if (level.cell[i] < 0 || level.cell[i] > outside) throw Invalid{"a piece is in no cell"};
  }

  Height* top;
  Byte* removable;  // null if nothing is removable
  std::int64_t wide, outside;
};

using ReadMap = Map<const float, const char>;
using WrittenMap = Map<float, char>;

// Splitting moves

// The number and the length of the pieces into which each move is split.
struct Split {
  Split(const Place* start_, const Place* end_, std::size_t n) : start(start_), end(end_), count(n), length(n) {
    for (std::size_t i = 0; i < n; ++i) {
      length[i] = std::hypot(end[i].x - start[i].x, end[i].y - start[i].y);
      const double pieces = std::max(std::ceil(length[i] / CELL), 1.0);
      if (!(pieces < MOST_PIECES)) throw Invalid{"a move is too long"};
      count[i] = static_cast<std::int64_t>(pieces);
      total += static_cast<std::size_t>(count[i]);
    }
  }

  // Writes the pieces to arrays of `total` numbers.
  void write(std::int64_t* move, double* x, double* y, double* z, double* piece_length) const {
    for (std::size_t i = 0; i < count.size(); ++i) {
      const double pieces = static_cast<double>(count[i]);
      const Place &a = start[i], &b = end[i], way{b.x - a.x, b.y - a.y, b.z - a.z};
      for (std::int64_t k = 0; k < count[i]; ++k) {
        const double share = (static_cast<double>(k) + 0.5) / pieces;
        *move++ = static_cast<std::int64_t>(i);
        *x++ = a.x + share * way.x;
        *y++ = a.y + share * way.y;
        *z++ = length[i] == 0 ? std::min(a.z, b.z) : a.z + share * way.z;
        *piece_length++ = length[i] / pieces;
      }
    }
  }

  const Place *start, *end;
  Indices count;
  std::vector<double> length;
  std::size_t total = 0;
};

// Finding unsupported pieces

std::vector<char> find_supported(const ReadMap& map, const Level& level, double gap, double drop) {
  std::vector<double> sag(level.n_moves);
  for (std::size_t i = 0; i < level.n_moves; ++i) sag[i] = level.strand_diameter(i) * MAX_SAG;
  std::vector<char> result(level.n_pieces);
  for (std::size_t i = 0; i < level.n_pieces; ++i) {
    const double lowest = level.z[i] - sag[level.move[i]] - drop;
    const auto reaches = [&](std::int64_t cell) {
      cell = std::min(std::max(cell, std::int64_t{0}), map.outside);
      const double top = map.top[cell];
      return (map.removable ? top + gap * map.removable[cell] : top) >= lowest - ROUNDING;
    };
    result[i] = lowest <= 0 || reaches(level.cell[i]);
    for (std::int64_t row = -SUPPORT_REACH; row <= SUPPORT_REACH && !result[i]; ++row)
      for (std::int64_t column = -SUPPORT_REACH; column <= SUPPORT_REACH && !result[i]; ++column)
        result[i] = reaches(level.cell[i] + row * map.wide + column);
  }
  return result;
}

// Marks the pieces of bridges as held: straight lines over a gap, supported at both ends.
void hold_bridges(const Level& level, const std::vector<char>& supported, std::vector<char>* held) {
  const std::size_t n = level.n_pieces;
  double total = 0, before;  // length of all pieces so far, and of those before the gap
  const auto continues = [&](std::size_t i) {  // whether the path goes on at piece i
    if (level.move[i] <= level.move[i - 1]) return true;
    const Place &from = level.end[level.move[i - 1]], &to = level.start[level.move[i]];
    return !(std::hypot(to.x - from.x, to.y - from.y) > NEGLIGIBLE);
  };
  for (std::size_t first = 0, last; first < n; first = last + 1) {
    last = first;
    before = total;
    total += level.length[first];
    if (supported[first]) continue;
    while (last + 1 < n && !supported[last + 1] && continues(last + 1)) total += level.length[++last];
    if (!first || last + 1 == n || !supported[first - 1] || !supported[last + 1]) continue;
    if (!continues(first) || !continues(last + 1)) continue;
    const double chord =
        std::hypot(level.x[last] - level.x[first], level.y[last] - level.y[first]) + level.length[first];
    if (chord >= MIN_STRAIGHTNESS * (total - before))
      std::fill(held->begin() + first, held->begin() + last + 1, 1);
  }
}

// Returns which pieces are near a seed, along cells with pieces and the cells beside them.
std::vector<char> find_near(const Level& level, std::int64_t wide, const std::vector<char>& seeds) {
  std::int64_t top = level.cell[0] / wide, bottom = top, left = level.cell[0] % wide, right = left;
  for (std::size_t i = 1; i < level.n_pieces; ++i) {
    const std::int64_t row = level.cell[i] / wide, column = level.cell[i] % wide;
    top = std::min(top, row);
    bottom = std::max(bottom, row);
    left = std::min(left, column);
    right = std::max(right, column);
  }
  const std::int64_t width = right - left + 1 + 2 * MARGIN, depth = bottom - top + 1 + 2 * MARGIN;
  if (width > MOST_CELLS / depth) throw Invalid{"the height map is too large"};
  Indices beside;
  for (std::int64_t row = -1; row <= 1; ++row)
    for (std::int64_t column = -1; column <= 1; ++column) beside.push_back(row * width + column);
  enum : char { EMPTY, FILLED, REACHED };
  std::vector<char> state(static_cast<std::size_t>(width * depth), EMPTY);
  std::vector<std::int32_t> place(level.n_pieces), reached, next;
  for (std::size_t i = 0; i < level.n_pieces; ++i) {
    const std::int64_t row = level.cell[i] / wide - top, column = level.cell[i] % wide - left;
    place[i] = static_cast<std::int32_t>((row + MARGIN) * width + column + MARGIN);
    for (const std::int64_t step : beside) state[place[i] + step] = FILLED;
  }
  const auto reach = [&](std::int64_t at) {
    if (state[at] != FILLED) return;
    state[at] = REACHED;
    next.push_back(static_cast<std::int32_t>(at));
  };
  for (std::size_t i = 0; i < level.n_pieces; ++i)
    if (seeds[i]) reach(place[i]);
  for (std::int64_t round = 0; round < MAX_OVERHANG && !next.empty(); ++round) {
    reached.swap(next);
    next.clear();
    for (const std::int64_t at : reached)
      for (const std::int64_t step : beside) reach(at + step);
  }
  std::vector<char> result(level.n_pieces);
  for (std::size_t i = 0; i < level.n_pieces; ++i) result[i] = state[place[i]] == REACHED;
  return result;
}

bool all(const std::vector<char>& values) { return std::find(values.begin(), values.end(), 0) == values.end(); }

Indices find_unsupported(const ReadMap& map, const Level& level, double gap, double drop) {
  const std::vector<char> supported = find_supported(map, level, gap, drop);
  if (all(supported)) return {};
  std::vector<char> held = supported;
  hold_bridges(level, supported, &held);
  if (all(held)) return {};
  const std::vector<char> near = find_near(level, map.wide, held);
  Indices result;
  for (std::size_t i = 0; i < level.n_pieces; ++i)
    if (!near[i] && !level.removable[level.move[i]]) result.push_back(static_cast<std::int64_t>(i));
  return result;
}

// Raising the height map

// Returns the height of a level above the print or the bed below it; 0 if all of it is as high.
double median_clearance(const WrittenMap& map, const Level& level) {
  std::vector<double> open;
  open.reserve(level.n_pieces);
  for (std::size_t i = 0; i < level.n_pieces; ++i) {
    const double clearance = level.z[i] - static_cast<double>(map.top[level.cell[i]]);
    if (clearance > SAME_HEIGHT) open.push_back(clearance);
  }
  if (open.empty()) return 0.0;
  const auto middle = open.begin() + open.size() / 2;
  std::nth_element(open.begin(), middle, open.end());
  const double lower = open.size() % 2 ? *middle : *std::max_element(open.begin(), middle);
  return (lower + *middle) / 2;
}

// The points beside each piece of a move that its extrusion covers.
class Cover {
 public:
  Cover(const Level& level, std::size_t move, double clearance) {
    const double strand = std::max(level.strand_diameter(move), NEGLIGIBLE);
    const double height = std::min(std::max(clearance, strand / MAX_FLATTENING), strand);
    const double width = strand * strand * (PI / 4) / height;
    const double spread = std::min(std::max(width - CELL, 0.0), MAX_WIDTH);  // distance between the outermost cells
    const double length = std::max(level.xy_length[move], NEGLIGIBLE), rows = std::ceil(spread / CELL);
    const Place &start = level.start[move], &end = level.end[move];
    const Point normal{-((end.y - start.y) / length), (end.x - start.x) / length};
    for (double k = 0; k <= rows; ++k) points_[size_++] = ((rows > 0 ? k / rows - 0.5 : 0.0) * spread) * normal;
  }
  const Point* begin() const { return points_; }
  const Point* end() const { return points_ + size_; }

 private:
  Point points_[static_cast<std::size_t>(MAX_WIDTH / CELL) + 2];
  std::size_t size_ = 0;
};

// Raises the map to the pieces of the moves that are removable, or of those that are not.
void raise_tops(const WrittenMap& map, const Level& level, double clearance, Point corner, char removable) {
  const double wide = static_cast<double>(map.wide), deep = static_cast<double>(map.outside / map.wide);
  for (std::size_t i = 0; i < level.n_pieces;) {
    const std::int64_t move = level.move[i];
    if (level.removable[move] != removable) {
      ++i;
      continue;
    }
    const Cover cover(level, static_cast<std::size_t>(move), clearance);
    for (; i < level.n_pieces && level.move[i] == move; ++i) {
      const float top = static_cast<float>(level.z[i]);
      for (const Point& beside : cover) {
        const double column = (beside.x + level.x[i] - corner.x) * (1 / CELL);
        const double row = (beside.y + level.y[i] - corner.y) * (1 / CELL);
        if (!(column > -1 && column < wide && row > -1 && row < deep)) continue;
        const std::int64_t cell = static_cast<std::int64_t>(row) * map.wide + static_cast<std::int64_t>(column);
        map.top[cell] = std::max(map.top[cell], top);
        if (map.removable) map.removable[cell] = removable;
      }
    }
  }
}

void raise_map(const WrittenMap& map, const Level& level, Point corner) {
  const double clearance = median_clearance(map, level);
  const bool is_any_removable = std::any_of(level.removable, level.removable + level.n_moves, [](char b) { return b; });
  if (is_any_removable && !map.removable) throw Invalid{"nothing can be removable"};
  if (is_any_removable) raise_tops(map, level, clearance, corner, 1);
  raise_tops(map, level, clearance, corner, 0);
}

// The arrays of a level as arguments: five of its moves, and six of its pieces.
class LevelArguments {
 public:
  explicit LevelArguments(PyObject* const (&objects)[11])
      : moves_{Numbers(objects[0]), Numbers(objects[1]), Numbers(objects[2]), Numbers(objects[3])},
        removable_(objects[4]),
        pieces_{Numbers(objects[5]), Numbers(objects[6]), Numbers(objects[7]),
                Numbers(objects[8]), Numbers(objects[9]), Numbers(objects[10])} {}

  bool valid() const { return pieces_[5].valid(); }  // then the others before are, too
  Level level() const { return Level(moves_, removable_, pieces_); }

 private:
  Numbers moves_[4];
  Elements<const char> removable_;
  Numbers pieces_[6];
};

}  // namespace

PyObject* find_unsupported_pieces(PyObject*, PyObject* arguments) {
  PyObject *top_object, *removable_object, *o[11];
  long long wide;
  double gap, drop;
  if (!PyArg_ParseTuple(arguments, "(OOL)(OOOOO)(OOOOOO)dd:find_unsupported_pieces", &top_object, &removable_object,
                        &wide, &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7], &o[8], &o[9], &o[10], &gap,
                        &drop))
    return nullptr;
  const Elements<const float> top(top_object);
  const Elements<const char> removable(removable_object);
  const LevelArguments given(o);
  if (!given.valid()) return nullptr;
  Indices result;
  const bool succeeded = run([&] {
    const Level level = given.level();
    result = find_unsupported(ReadMap(top, removable, wide, level), level, gap, drop);
  });
  return succeeded ? to_bytes(result) : nullptr;
}

PyObject* raise_height_map(PyObject*, PyObject* arguments) {
  PyObject *top_object, *removable_object, *o[11];
  long long wide;
  Point corner;
  if (!PyArg_ParseTuple(arguments, "(OOL)(OOOOO)(OOOOOO)dd:raise_height_map", &top_object, &removable_object, &wide,
                        &o[0], &o[1], &o[2], &o[3], &o[4], &o[5], &o[6], &o[7], &o[8], &o[9], &o[10], &corner.x,
                        &corner.y))
    return nullptr;
  const Elements<float> top(top_object);
  const Elements<char> removable(removable_object);
  const LevelArguments given(o);
  if (!given.valid()) return nullptr;
  const bool succeeded = run([&] {
    const Level level = given.level();
    raise_map(WrittenMap(top, removable, wide, level), level, corner);
  });
  return succeeded ? Py_NewRef(Py_None) : nullptr;
}

PyObject* split_moves(PyObject*, PyObject* arguments) {
  PyObject *start_object, *end_object;
  if (!PyArg_ParseTuple(arguments, "OO:split_moves", &start_object, &end_object)) return nullptr;
  const Numbers start(start_object), end(end_object);
  if (!start.valid() || !end.valid()) return nullptr;
  std::optional<Split> split;
  const bool succeeded = run([&] {
    if (!start.is_whole() || !end.is_whole() || start.size() != end.size() || start.size() % 3)
      throw Invalid{"the moves do not match"};
    split.emplace(reinterpret_cast<const Place*>(start.doubles()), reinterpret_cast<const Place*>(end.doubles()),
                  start.size() / 3);
  });
  if (!succeeded) return nullptr;
  // The pieces of a large layer take much memory, so they are written without a copy.
  PyObject* result = PyTuple_New(5);
  char* arrays[5];
  for (Py_ssize_t i = 0; result && i < 5; ++i) {
    PyObject* array = PyBytes_FromStringAndSize(nullptr, static_cast<Py_ssize_t>(split->total * sizeof(double)));
    if (!array || PyTuple_SetItem(result, i, array)) Py_CLEAR(result);
    if (result) arrays[i] = PyBytes_AsString(array);
  }
  if (!result) return nullptr;
  const auto column = [&](int i) { return reinterpret_cast<double*>(arrays[i]); };
  const bool written = run([&] {
    split->write(reinterpret_cast<std::int64_t*>(arrays[0]), column(1), column(2), column(3), column(4));
  });
  if (!written) Py_CLEAR(result);
  return result;
}
