// Numbers for the exact predicates of Boost.Polygon's Voronoi diagram: faster, with the same results to the last bit.
//
// Where the rounding of doubles leaves a predicate undecided, Boost computes with integers of up to 64 chunks of 32 bits
// and with doubles that have a separate exponent. Its traits allow other types for both. These compute with 64 bits at
// once, copy only what is used, and split doubles without a call. Boost rounds an integer to a double by its three
// highest chunks, of which some may be 0 after a subtraction; so chunks are counted here as Boost counts them.

#ifndef PRINTER_SLICER_EXACT
#define PRINTER_SLICER_EXACT

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>

#include "boost/polygon/detail/voronoi_ctypes.hpp"

namespace exact {

// Returns the low 64 bits of a * b + c + d, and puts the high 64 bits into *high.
inline std::uint64_t multiply(std::uint64_t a, std::uint64_t b, std::uint64_t c, std::uint64_t d,
                              std::uint64_t* high) {
#ifdef __SIZEOF_INT128__
  const unsigned __int128 product = static_cast<unsigned __int128>(a) * b + c + d;
  *high = static_cast<std::uint64_t>(product >> 64);
  return static_cast<std::uint64_t>(product);
#else
  const std::uint64_t mask = 0xFFFFFFFF, a0 = a & mask, a1 = a >> 32, b0 = b & mask, b1 = b >> 32;
  const std::uint64_t low = a0 * b0, cross = a1 * b0 + (low >> 32), other = a0 * b1 + (cross & mask);
  std::uint64_t result = (other << 32) | (low & mask);
  *high = a1 * b1 + (cross >> 32) + (other >> 32);
  result += c;
  *high += result < c;
  result += d;
  *high += result < d;
  return result;
#endif
}

// An integer of sign and magnitude, with `size()` chunks of 32 bits; chunks above it are 0 in the last limb.
class Integer {
 public:
  Integer() { limbs_[0] = limbs_[1] = 0; }
  Integer(std::int32_t value) : Integer() { set(value); }
  Integer(std::int64_t value) : Integer() { set(value); }
  Integer(const Integer& that) { copy(that); }
  Integer& operator=(const Integer& that) {
    copy(that);
    return *this;
  }

  int count() const { return count_; }
  std::size_t size() const { return static_cast<std::size_t>(count_ < 0 ? -count_ : count_); }

  Integer operator-() const {
    Integer result(*this);
    result.count_ = -count_;
    return result;
  }
  Integer operator+(const Integer& that) const { return sum(that, that.count_); }
  Integer operator-(const Integer& that) const { return sum(that, -that.count_); }
  Integer operator*(const Integer& that) const {
    Integer result;
    const std::size_t n = size(), m = that.size();
    if (!n || !m) {
      result.count_ = 0;
      return result;
    }
    if (n <= 2 && m <= 2) {  // most are so small
      result.limbs_[0] = multiply(limbs_[0], that.limbs_[0], 0, 0, &result.limbs_[1]);
      result.set_size(n + m - 1);
    } else {
      result.multiply_magnitudes(*this, that);
    }
    if ((count_ ^ that.count_) < 0) result.count_ = -result.count_;
    return result;
  }

  // Returns a double and the exponent of 2 by which it must be multiplied.
  std::pair<double, int> to_double() const {
    const std::size_t n = size();
    std::pair<double, int> result(0.0, 0);
    if (!n) return result;
    if (n <= 2) {
      result.first = static_cast<double>(limbs_[0]);
    } else {
      const std::uint64_t top = static_cast<std::uint64_t>(chunk(n - 1)) << 32 | chunk(n - 2);
      result.first = static_cast<double>(top) * 4294967296.0 + static_cast<double>(chunk(n - 3));
      result.second = static_cast<int>((n - 3) * 32);
    }
    if (count_ < 0) result.first = -result.first;
    return result;
  }

 private:
  static constexpr std::size_t CHUNKS = 64, LIMBS = CHUNKS / 2;

  static std::size_t limbs_of(std::size_t chunks) { return (chunks + 1) / 2; }

  std::uint32_t chunk(std::size_t i) const { return static_cast<std::uint32_t>(limbs_[i / 2] >> (i % 2 * 32)); }

  void set(std::int64_t value) {
    limbs_[0] = value < 0 ? 0 - static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value);
    count_ = limbs_[0] >> 32 ? 2 : limbs_[0] ? 1 : 0;
    if (value < 0) count_ = -count_;
  }

  void copy(const Integer& that) {
    count_ = that.count_;
    limbs_[0] = that.limbs_[0];
    limbs_[1] = that.limbs_[1];
    for (std::size_t i = 2, n = limbs_of(that.size()); i < n; ++i) limbs_[i] = that.limbs_[i];
  }

  // Returns the sum of this and `that` if that had the sign of `sign`.
  Integer sum(const Integer& that, int sign) const {
    if (!that.count_) return *this;
    if (!count_) {
      Integer result(that);
      result.count_ = sign;
      return result;
    }
    Integer result;
    if ((count_ > 0) == (sign > 0))
      result.add_magnitudes(*this, that);
    else
      result.subtract_magnitudes(*this, that);
    if (count_ < 0) result.count_ = -result.count_;
    return result;
  }

  // Sets the number of chunks to n, or to n + 1 if the chunk above is not 0.
  void set_size(std::size_t n) {
    count_ = static_cast<int>(n < CHUNKS && chunk(n) ? n + 1 : n);
  }

  void add_magnitudes(const Integer& a, const Integer& b) {
    if (a.size() < b.size()) return add_magnitudes(b, a);
    const std::size_t n = limbs_of(a.size()), m = limbs_of(b.size());
    std::uint64_t carry = 0, limb = 0;
    for (std::size_t i = 0; i < m; ++i) {
      const std::uint64_t partial = a.limbs_[i] + carry;
      limb = partial + b.limbs_[i];
      carry = (partial < carry) | (limb < partial);
      limbs_[i] = limb;
    }
    for (std::size_t i = m; i < n; ++i) {
      limb = a.limbs_[i] + carry;
      carry = limb < carry;
      limbs_[i] = limb;
    }
    if (n < LIMBS) limbs_[n] = carry;
    const std::uint64_t above = a.size() % 2 ? limb >> 32 : carry;
    count_ = static_cast<int>(a.size() < CHUNKS && above ? a.size() + 1 : a.size());
  }

  // The result is negative if b is greater than a.
  void subtract_magnitudes(const Integer& a, const Integer& b) {
    std::size_t n = a.size();
    bool swap = n < b.size();
    if (swap) {
      n = b.size();
    } else if (n == b.size()) {  // chunks that are equal at the top drop out
      while (n && a.chunk(n - 1) == b.chunk(n - 1)) --n;
      if (!n) {
        count_ = 0;
        return;
      }
      swap = a.chunk(n - 1) < b.chunk(n - 1);
    }
    subtract_limbs(swap ? b : a, swap ? a : b, n);
    if (swap) count_ = -count_;
  }

  // Subtracts the lowest n chunks of b, the smaller number, from those of a.
  void subtract_limbs(const Integer& a, const Integer& b, std::size_t n) {
    const std::size_t limbs = limbs_of(n), m = (std::min)(limbs, limbs_of(b.size()));
    std::uint64_t borrow = 0, limb = 0;
    for (std::size_t i = 0; i < m; ++i) {
      const std::uint64_t partial = a.limbs_[i] - borrow;
      limb = partial - b.limbs_[i];
      borrow = (a.limbs_[i] < borrow) | (partial < b.limbs_[i]);
      limbs_[i] = limb;
    }
    for (std::size_t i = m; i < limbs; ++i) {
      limb = a.limbs_[i] - borrow;
      borrow = a.limbs_[i] < borrow;
      limbs_[i] = limb;
    }
    if (n % 2) limbs_[limbs - 1] = limb &= 0xFFFFFFFF;
    const std::uint64_t top = n % 2 ? limb : limb >> 32;
    count_ = static_cast<int>(top ? n : n - 1);
  }

  void multiply_magnitudes(const Integer& a, const Integer& b) {
    const std::size_t n = limbs_of(a.size()), m = limbs_of(b.size());
    for (std::size_t i = 0; i < n; ++i) {
      std::uint64_t carry = 0;
      std::size_t j = 0;
      for (; j < m && i + j < LIMBS; ++j)
        limbs_[i + j] = multiply(a.limbs_[i], b.limbs_[j], i ? limbs_[i + j] : 0, carry, &carry);
      if (i + j < LIMBS) limbs_[i + j] = carry;
    }
    set_size((std::min)(CHUNKS, a.size() + b.size() - 1));
  }

  int count_;  // first, because both it and the lowest limbs are always used
  std::uint64_t limbs_[LIMBS];
};

inline bool is_pos(const Integer& value) { return value.count() > 0; }
inline bool is_neg(const Integer& value) { return value.count() < 0; }
inline bool is_zero(const Integer& value) { return value.count() == 0; }

// Returns 2 to the power of `exponent`, from -1022 to 1023.
inline double power_of_2(int exponent) {
  const std::uint64_t bits = static_cast<std::uint64_t>(exponent + 1023) << 52;
  double result;
  std::memcpy(&result, &bits, sizeof result);
  return result;
}

// A double in [0.5, 1), or 0, with the exponent of 2 by which it must be multiplied.
class Scaled {
 public:
  explicit Scaled(double value, int exponent = 0) {
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    const int biased = static_cast<int>(bits >> 52 & 0x7FF);
    if (biased == 0 || biased == 0x7FF) {  // 0, and what sides of areas do not lead to
      value_ = std::frexp(value, &exponent_);
    } else {
      bits = (bits & ~(0x7FFULL << 52)) | 0x3FEULL << 52;
      std::memcpy(&value_, &bits, sizeof bits);
      exponent_ = biased - 1022;
    }
    exponent_ += exponent;
  }

  bool is_pos() const { return value_ > 0; }
  bool is_neg() const { return value_ < 0; }
  bool is_zero() const { return value_ == 0; }

  Scaled operator-() const { return Scaled(-value_, exponent_); }
  Scaled operator+(const Scaled& that) const {
    if (value_ == 0.0 || that.exponent_ > exponent_ + DIGITS) return that;
    if (that.value_ == 0.0 || exponent_ > that.exponent_ + DIGITS) return *this;
    if (exponent_ >= that.exponent_)
      return Scaled(value_ * power_of_2(exponent_ - that.exponent_) + that.value_, that.exponent_);
    return Scaled(that.value_ * power_of_2(that.exponent_ - exponent_) + value_, exponent_);
  }
  Scaled operator-(const Scaled& that) const { return *this + -that; }
  Scaled operator*(const Scaled& that) const {
    return Scaled(value_ * that.value_, exponent_ + that.exponent_);
  }
  Scaled operator/(const Scaled& that) const {
    return Scaled(value_ / that.value_, exponent_ - that.exponent_);
  }

  Scaled sqrt() const {
    const int odd = exponent_ & 1;
    return Scaled(std::sqrt(odd ? value_ * 2.0 : value_), (exponent_ - odd) >> 1);
  }

  double to_double() const { return std::ldexp(value_, exponent_); }

 private:
  static constexpr int DIGITS = 54;  // a summand that is so much smaller does not count

  double value_;
  int exponent_;
};

inline bool is_pos(const Scaled& value) { return value.is_pos(); }
inline bool is_neg(const Scaled& value) { return value.is_neg(); }
inline bool is_zero(const Scaled& value) { return value.is_zero(); }
inline Scaled get_sqrt(const Scaled& value) { return value.sqrt(); }

struct ToDouble {
  template <typename T>
  double operator()(const T& value) const {
    return static_cast<double>(value);
  }
  double operator()(const Integer& value) const {
    const std::pair<double, int> parts = value.to_double();
    return std::ldexp(parts.first, parts.second);
  }
  double operator()(const Scaled& value) const { return value.to_double(); }
};

struct ToScaled {
  Scaled operator()(const Integer& value) const {
    const std::pair<double, int> parts = value.to_double();
    return Scaled(parts.first, parts.second);
  }
};

// Types for boost::polygon::voronoi_builder.
struct Traits {
  typedef std::int32_t int_type;
  typedef std::int64_t int_x2_type;
  typedef std::uint64_t uint_x2_type;
  typedef Integer big_int_type;
  typedef double fpt_type;
  typedef Scaled efpt_type;
  typedef boost::polygon::detail::ulp_comparison<double> ulp_cmp_type;
  typedef ToDouble to_fpt_converter_type;
  typedef ToScaled to_efpt_converter_type;
};

}  // namespace exact

#endif  // PRINTER_SLICER_EXACT
