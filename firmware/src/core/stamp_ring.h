// Changes of pins on their way from the interrupt to the loop.
#ifndef DART_CORE_STAMP_RING_H
#define DART_CORE_STAMP_RING_H

#include <stdint.h>

namespace dart {

struct PinStamp {
  uint16_t at;
  uint8_t levels;
};

// One writer, the interrupt, and one reader, the loop. Bytes alone are
// shared, so neither locks the other out.
struct StampRing {
  // Three channels make 6 changes in 20 ms; the loop comes at least each
  // 10 ms.
  static constexpr uint8_t kSize = 16;  // a power of two

  PinStamp stamps[kSize];
  volatile uint8_t written;
  volatile uint8_t taken;

  // False: full, the change is lost.
  bool put(uint16_t at, uint8_t levels) {
    uint8_t const n = written;
    if (static_cast<uint8_t>(n - taken) >= kSize) {
      return false;
    }
    stamps[n % kSize] = {at, levels};
    written = static_cast<uint8_t>(n + 1);
    return true;
  }

  bool take(PinStamp& out) {
    uint8_t const n = taken;
    if (n == written) {
      return false;
    }
    out = stamps[n % kSize];
    taken = static_cast<uint8_t>(n + 1);
    return true;
  }
};
static_assert((StampRing::kSize & (StampRing::kSize - 1)) == 0,
              "the counts wrap at a multiple of it");

}  // namespace dart

#endif  // DART_CORE_STAMP_RING_H
