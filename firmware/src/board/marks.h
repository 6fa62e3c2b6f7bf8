// Marks for measurements in the emulator: a test build writes the number of
// a section to GPIOR0 when it begins and 0 when it ends (one cycle each).
#ifndef DART_BOARD_MARKS_H
#define DART_BOARD_MARKS_H

#include <avr/io.h>

namespace dart {
namespace board {

enum class Mark : uint8_t {
  kNone = 0,
  kAtomic = 1,  // interrupts are off
  kBuild = 2,   // the frame builder
};

#if defined(DART_TEST)
inline void mark(Mark section) { GPIOR0 = static_cast<uint8_t>(section); }
#else
inline void mark(Mark) {}
#endif

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_MARKS_H
