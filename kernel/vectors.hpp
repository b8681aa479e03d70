// Vectors in the plane, with the rounding of printer_slicer/geometry/vectors.py.

#ifndef PRINTER_SLICER_VECTORS
#define PRINTER_SLICER_VECTORS

#include <algorithm>
#include <cmath>

struct Point {
  double x, y;
};

inline Point operator+(Point a, Point b) { return {a.x + b.x, a.y + b.y}; }
inline Point operator-(Point a, Point b) { return {a.x - b.x, a.y - b.y}; }
inline Point operator-(Point a) { return {-a.x, -a.y}; }
inline Point operator*(double factor, Point a) { return {factor * a.x, factor * a.y}; }
inline double dot(Point a, Point b) { return a.x * b.x + a.y * b.y; }
inline double cross(Point a, Point b) { return a.x * b.y - a.y * b.x; }
inline double norm(Point a) { return std::sqrt(dot(a, a)); }

inline Point nearest_on_segment(Point point, Point begin, Point end) {
  const Point way = end - begin;
  const double length2 = dot(way, way);
  const double share = dot(point - begin, way) / (length2 > 0 ? length2 : 1.0);
  return begin + std::min(std::max(share, 0.0), 1.0) * way;
}

#endif
