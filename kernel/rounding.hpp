// Rounding to the nearest integer, of two equally near ones to the even one.

#ifndef PRINTER_SLICER_ROUNDING
#define PRINTER_SLICER_ROUNDING

#include <cmath>
#include <cstdint>

#if defined(__x86_64__) || defined(_M_AMD64)
#include <emmintrin.h>
#endif

inline std::int64_t round_to_integer(double value) {
#if defined(__x86_64__) || defined(_M_AMD64)
  return _mm_cvtsd_si64(_mm_set_sd(value));  // one instruction instead of a call
#else
  return static_cast<std::int64_t>(std::nearbyint(value));
#endif
}

#endif
