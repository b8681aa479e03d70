// Integer types under the names of Boost, instead of Boost's header, which includes its large configuration.

#ifndef PRINTER_SLICER_CSTDINT
#define PRINTER_SLICER_CSTDINT

#include <cstdint>

namespace boost {
using std::int32_t;
using std::int64_t;
using std::uint32_t;
using std::uint64_t;
}  // namespace boost

#endif  // PRINTER_SLICER_CSTDINT
