// Sums in the order of numpy, because rounding depends on it.

#ifndef PRINTER_SLICER_SUMS
#define PRINTER_SLICER_SUMS

#include <cstddef>

// Returns the sum as in the reductions of numpy. Source: numpy/_core/src/umath/loops_utils.h.src, pairwise sum.
inline double sum_pairwise(const double* values, std::size_t n) {
  if (n < 8) {
    double sum = 0;
    for (std::size_t i = 0; i < n; ++i) sum += values[i];
    return sum;
  }
  if (n > 128) {
    const std::size_t half = n / 2 - n / 2 % 8;
    return sum_pairwise(values, half) + sum_pairwise(values + half, n - half);
  }
  double sums[8];
  std::size_t i = 0;
  for (; i < 8; ++i) sums[i] = values[i];
  for (; i < n - n % 8; i += 8)
    for (std::size_t k = 0; k < 8; ++k) sums[k] += values[i + k];
  double sum = ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
  for (; i < n; ++i) sum += values[i];
  return sum;
}

// Returns the sum of n > 0 values as `np.add.reduceat` does, which begins with the first one.
inline double sum_like_numpy(const double* values, std::size_t n) { return values[0] + sum_pairwise(values + 1, n - 1); }

#endif
