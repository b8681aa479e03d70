// Distances from points to segments, rounded as GEOS rounds them, so that nearest segments and needed points are the same.

#ifndef PRINTER_SLICER_SEGMENTS
#define PRINTER_SLICER_SEGMENTS

#include <cmath>

#include "vectors.hpp"

inline double distance_between(const Point& one, const Point& other) {
  const double x = one.x - other.x, y = one.y - other.y;
  return std::sqrt(x * x + y * y);
}

// Source: comp.graphics.algorithms, Frequently Asked Questions, 1.02: how do I find the distance from a point to a line?
inline double distance_to_segment(const Point& point, const Point& begin, const Point& end) {
  const double x = end.x - begin.x, y = end.y - begin.y;
  if (x == 0 && y == 0) return distance_between(point, begin);
  const double length2 = x * x + y * y;
  const double share = ((point.x - begin.x) * x + (point.y - begin.y) * y) / length2;
  if (share <= 0) return distance_between(point, begin);
  if (share >= 1) return distance_between(point, end);
  const double side = ((begin.y - point.y) * x - (begin.x - point.x) * y) / length2;
  return std::fabs(side) * std::sqrt(length2);
}

#endif
