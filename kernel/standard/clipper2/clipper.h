// The part of Clipper2's header clipper.h that its engine uses; that header includes all other parts of Clipper2.

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

}  // namespace Clipper2Lib

#endif
