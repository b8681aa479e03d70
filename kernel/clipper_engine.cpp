// Compiles the engine of Clipper2, and its offsets.

#include "rounding.hpp"

// For the compiler of Microsoft, the engine itself replaces this function, which it calls most.
#include "clipper2/clipper.core.h"
#if defined(__x86_64__) && !defined(_MSC_VER)
#define nearbyint(value) round_to_integer(value)
#endif
#include "clipper2/clipper.engine.cpp"
#include "clipper2/clipper.offset.cpp"
