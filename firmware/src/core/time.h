// Time of the device: u32 counts of 0.5 us that wrap every 2147.48 s.
#ifndef DART_CORE_TIME_H
#define DART_CORE_TIME_H

#include <stdint.h>

namespace dart {

using Tick = uint32_t;

// Timer1 counts 16 MHz / 8 = 2 MHz, whatever the core does with it.
constexpr Tick kTicksPerUs = 2;
constexpr Tick kTicksPerMs = 2000;
// One telemetry slot, 100 Hz.
constexpr Tick kTicksPerSlot = 10 * kTicksPerMs;

constexpr Tick ticks_of_ms(uint32_t ms) { return ms * kTicksPerMs; }

// Times are compared by their difference, never by value. Both helpers are
// right while the two times lie less than 1073 s apart.
inline bool reached(Tick now, Tick deadline) {
  return static_cast<int32_t>(now - deadline) >= 0;
}

// Full time of an event known by its low word, if it lies less than
// 32.77 ms before `now`.
inline Tick extended(Tick now, uint16_t low) {
  return now - static_cast<uint16_t>(static_cast<uint16_t>(now) - low);
}

}  // namespace dart

#endif  // DART_CORE_TIME_H
