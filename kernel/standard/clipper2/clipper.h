// The part of Clipper2's header clipper.h that its engine and offsets use; that header includes all other parts.

#ifndef PRINTER_SLICER_CLIPPER
#define PRINTER_SLICER_CLIPPER

#include "clipper2/clipper.engine.h"

namespace Clipper2Lib {

  template <typename T>
  inline bool Path2ContainsPath1(const Path<T>& path1, const Path<T>& path2)
  {
    // precondition: paths must not intersect, except for
    // transient (and presumed 'micro') path intersections
    PointInPolygonResult pip = PointInPolygonResult::IsOn;
    for (const Point<T>& pt : path1)
    {
      switch (PointInPolygon(pt, path2))
      {
      case PointInPolygonResult::IsOutside:
        if (pip == PointInPolygonResult::IsOutside) return false;
        pip = PointInPolygonResult::IsOutside;
        break;
      case PointInPolygonResult::IsInside:
        if (pip == PointInPolygonResult::IsInside) return true;
        pip = PointInPolygonResult::IsInside;
        break;
      default:
        break;
      }
    }
    if (pip != PointInPolygonResult::IsInside) return false;
    // result is likely true but check midpoint
    Point<T> mp1 = GetBounds(path1).MidPoint();
    return PointInPolygon(mp1, path2) == PointInPolygonResult::IsInside;
  }

  template <typename T>
  inline Path<T> Ellipse(const Point<T>& center,
    double radiusX, double radiusY = 0, size_t steps = 0)
  {
    if (radiusX <= 0) return Path<T>();
    if (radiusY <= 0) radiusY = radiusX;
    if (steps <= 2)
      steps = static_cast<size_t>(PI * sqrt((radiusX + radiusY) / 2));

    double si = std::sin(2 * PI / steps);
    double co = std::cos(2 * PI / steps);
    double dx = co, dy = si;
    Path<T> result;
    result.reserve(steps);
    result.emplace_back(center.x + radiusX, static_cast<double>(center.y));
    for (size_t i = 1; i < steps; ++i)
    {
      result.emplace_back(center.x + radiusX * dx, center.y + radiusY * dy);
      double x = dx * co - dy * si;
      dy = dy * co + dx * si;
      dx = x;
    }
    return result;
  }

}  // namespace Clipper2Lib

#endif
