// The exact circle through a point that touches two sides: as in Boost.Polygon, with the same results to the last bit.
//
// Boost evaluates four expressions with the same roots; here the roots and other common terms are computed once.

#ifndef PRINTER_SLICER_EXACT_CIRCLE
#define PRINTER_SLICER_EXACT_CIRCLE

#include "boost/polygon/voronoi_builder.hpp"
#include "exact.hpp"

namespace exact {

inline bool have_same_sign(const Scaled& a, const Scaled& b) {
  return (!a.is_neg() && !b.is_neg()) || (!a.is_pos() && !b.is_pos());
}

// Sums of A[0] * sqrt(B[0]), A[1] * sqrt(B[1]), A[2] * sqrt(B[3] * (sqrt(B[0] * B[1]) + B[2])), and an integer.
class CircleSum {
 public:
  CircleSum(const Integer& b0, const Integer& b1, const Integer& b2, const Integer& b3)
      : b0_(b0),
        b1_(b1),
        b2_(b2),
        b3_(b3),
        b01_(b0 * b1),
        root0_(root_of(b0)),
        root1_(root_of(b1)),
        root3_(root_of(b3)),
        root01_(root_of(b01_)),
        nested_(compute_nested()) {}

  Scaled sum(const Integer& a0, const Integer& a1, const Integer& a2) const {
    const Scaled left = sum_of_two(a0, a1), right = nested_term(a2);
    if (have_same_sign(left, right)) return left + right;
    const Integer square = a2 * a2 * b3_;
    const Integer even = a0 * a0 * b0_ + a1 * a1 * b1_ - a2 * a2 * b3_ * b2_;
    return with_product(even, a0 * a1 * Integer(2) - square) / (left - right);
  }

  // The same plus `a3`, which is not 0.
  Scaled sum(const Integer& a0, const Integer& a1, const Integer& a2, const Integer& a3) const {
    const Scaled left = sum_of_three(a0, a1, a3), right = nested_term(a2);
    if (have_same_sign(left, right)) return left + right;
    const Integer even =
        a0 * a0 * b0_ + a1 * a1 * b1_ + a3 * a3 - a2 * a2 * b2_ * b3_;
    const Integer odd = a0 * a1 * Integer(2) - a2 * a2 * b3_;
    return sum_of_four(a3 * a0 * Integer(2), a3 * a1 * Integer(2), even, odd) / (left - right);
  }

 private:
  static Scaled root_of(const Integer& value) { return scale_(value).sqrt(); }

  // Returns sqrt(sqrt(B[0] * B[1]) + B[2]).
  Scaled compute_nested() const {
    const Scaled a = scale_(Integer(1)) * root01_, b = scale_(b2_) * root_of(1);
    if (have_same_sign(a, b)) return (a + b).sqrt();
    return (scale_(b01_ - b2_ * b2_) / (a - b)).sqrt();
  }

  Scaled nested_term(const Integer& a2) const { return scale_(a2) * root3_ * nested_; }

  // Returns a0 * sqrt(B[0]) + a1 * sqrt(B[1]).
  Scaled sum_of_two(const Integer& a0, const Integer& a1) const {
    const Scaled a = scale_(a0) * root0_, b = scale_(a1) * root1_;
    if (have_same_sign(a, b)) return a + b;
    return scale_(a0 * a0 * b0_ - a1 * a1 * b1_) / (a - b);
  }

  // Returns a0 + a1 * sqrt(B[0] * B[1]).
  Scaled with_product(const Integer& a0, const Integer& a1) const {
    const Scaled a = scale_(a0) * root_of(1), b = scale_(a1) * root01_;
    if (have_same_sign(a, b)) return a + b;
    return scale_(a0 * a0 - a1 * a1 * b01_) / (a - b);
  }

  // Returns a0 * sqrt(B[0]) + a1 * sqrt(B[1]) + a2.
  Scaled sum_of_three(const Integer& a0, const Integer& a1, const Integer& a2) const {
    const Scaled a = sum_of_two(a0, a1), b = scale_(a2) * root_of(1);
    if (have_same_sign(a, b)) return a + b;
    const Integer even = a0 * a0 * b0_ + a1 * a1 * b1_ - a2 * a2;
    return with_product(even, a0 * a1 * Integer(2)) / (a - b);
  }

  // Returns a0 * sqrt(B[0]) + a1 * sqrt(B[1]) + a2 + a3 * sqrt(B[0] * B[1]).
  Scaled sum_of_four(const Integer& a0, const Integer& a1, const Integer& a2, const Integer& a3) const {
    const Scaled a = sum_of_two(a0, a1), b = with_product(a2, a3);
    if (have_same_sign(a, b)) return a + b;
    const Integer even = a0 * a0 * b0_ + a1 * a1 * b1_ - a2 * a2 - a3 * a3 * b0_ * b1_;
    return with_product(even, (a0 * a1 - a2 * a3) * Integer(2)) / (a - b);
  }

  static constexpr ToScaled scale_{};
  Integer b0_, b1_, b2_, b3_, b01_;
  Scaled root0_, root1_, root3_, root01_, nested_;
};

using Site = boost::polygon::detail::site_event<std::int32_t>;
using Circle = boost::polygon::detail::circle_event<double>;

// A circle for which Boost's own function is used.
struct PlainCircle : Circle {
  PlainCircle() = default;
  PlainCircle(double x, double y, double lower_x) : Circle(x, y, lower_x) {}
  explicit PlainCircle(const Circle& that) : Circle(that) {}
};

}  // namespace exact

namespace boost {
namespace polygon {
namespace detail {

// `point_index` is the place of the point, site1, among the three sites.
template <>
template <>
inline void voronoi_predicates<exact::Traits>::mp_circle_formation_functor<exact::Site, exact::Circle>::pss(
    const exact::Site& site1, const exact::Site& site2, const exact::Site& site3, int point_index,
    exact::Circle& circle, bool recompute_c_x, bool recompute_c_y, bool recompute_lower_x) {
  using exact::Integer;
  const auto difference = [](std::int32_t a, std::int32_t b) {
    return Integer(static_cast<std::int64_t>(a) - static_cast<std::int64_t>(b));
  };
  const auto end1 = site2.point0(), start1 = site2.point1(), start2 = site3.point0(), end2 = site3.point1();
  const Integer a0 = difference(end1.x(), start1.x()), b0 = difference(end1.y(), start1.y());
  const Integer a1 = difference(end2.x(), start2.x()), b1 = difference(end2.y(), start2.y());
  const Integer orientation = a1 * b0 - a0 * b1;
  const Integer c0 = b0 * Integer(end1.x()) - a0 * Integer(end1.y());
  const Integer c1 = a1 * Integer(end2.y()) - b1 * Integer(end2.x());
  const Integer ix = a0 * c1 + a1 * c0, iy = b0 * c1 + b1 * c0;
  const Integer dx = ix - orientation * Integer(site1.x()), dy = iy - orientation * Integer(site1.y());
  if (is_zero(orientation) || (is_zero(dx) && is_zero(dy))) {  // parallel sides, or the point where they meet
    exact::PlainCircle plain(circle);
    mp_circle_formation_functor<exact::Site, exact::PlainCircle>().pss(
        site1, site2, site3, point_index, plain, recompute_c_x, recompute_c_y, recompute_lower_x);
    circle = plain;
    return;
  }
  const bool is_positive = (point_index == 2) == is_neg(orientation);
  const auto with_sign = [&](const Integer& value) { return is_positive ? value : -value; };
  const Integer along0 = dx * a0 + dy * b0, along1 = dx * a1 + dy * b1, square = dx * dx + dy * dy;
  const exact::CircleSum roots(a0 * a0 + b0 * b0, a1 * a1 + b1 * b1, a0 * a1 + b0 * b1,
                               (a0 * dy - b0 * dx) * (a1 * dy - b1 * dx) * Integer(-2));
  const double part = to_fpt(roots.sum(-along1, -along0, with_sign(1)));
  const double divisor = part * to_fpt(orientation);
  if (recompute_c_y) {
    const Integer first = b1 * square - iy * along1, second = b0 * square - iy * along0;
    circle.y(to_fpt(roots.sum(first, second, with_sign(iy))) / divisor);
  }
  if (!recompute_c_x && !recompute_lower_x) return;
  const Integer first = a1 * square - ix * along1, second = a0 * square - ix * along0, third = with_sign(ix);
  if (recompute_c_x) circle.x(to_fpt(roots.sum(first, second, third)) / divisor);
  if (recompute_lower_x) {
    const Integer radius = orientation * square;
    circle.lower_x(to_fpt(roots.sum(first, second, third, is_neg(part) ? -radius : radius)) / divisor);
  }
}

}  // namespace detail
}  // namespace polygon
}  // namespace boost

#endif  // PRINTER_SLICER_EXACT_CIRCLE
