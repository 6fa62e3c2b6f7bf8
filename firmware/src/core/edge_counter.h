// One encoder ring as its interrupt sees it: a count and the newest stamps.
//
// Everything here is 16 bits wide so that the interrupt stays short; the
// Encoder extends count and stamps in the loop, which looks at least every
// slot, three times faster than the stamps wrap (32.77 ms).
#ifndef DART_CORE_EDGE_COUNTER_H
#define DART_CORE_EDGE_COUNTER_H

#include <stdint.h>

namespace dart {

// Shared with an interrupt: read it with interrupts off.
struct EdgeCounter {
  // Stamps kept: at 5000 edges/s the loop has 3.2 ms to collect them.
  static constexpr uint8_t kKept = 16;

  uint16_t stamps[kKept];  // stamp of edge n at n % kKept, n from 0
  uint16_t count;          // accepted edges
  uint16_t last;           // stamp of the newest accepted edge
  uint16_t rejects;        // edges refused by the glitch rule
  uint16_t min_ticks;      // shortest interval; 0 = no glitch rule
  uint8_t level;           // pin level after the newest accepted edge
  bool open;               // the newest edge is older than min_ticks

  // The pin has changed: called by the interrupt with the time it read
  // first and the level it read after that.
  //
  // The glitch rule refuses an edge that comes too soon after an accepted
  // one, or whose level has already gone back. `open` keeps the 16-bit
  // interval from aliasing: refresh() sets it long before 32.77 ms are over.
  __attribute__((always_inline)) void edge(uint16_t now, uint8_t now_level) {
    if (min_ticks != 0) {
      bool const soon =
          !open && static_cast<uint16_t>(now - last) < min_ticks;
      if (soon || now_level == level) {
        ++rejects;
        return;
      }
      level = now_level;
      last = now;
      open = false;
    }
    uint16_t const n = count;
    stamps[static_cast<uint8_t>(n) % kKept] = now;
    count = static_cast<uint16_t>(n + 1);
  }

  // Called by the slot interrupt, at least every 20 ms.
  void refresh(uint16_t now) {
    if (!open && static_cast<uint16_t>(now - last) >= min_ticks) {
      open = true;
    }
  }

  // Level at which the count was 0, from now on the reference of parity.
  void start(uint8_t now_level, uint16_t min) {
    level = now_level;
    min_ticks = min;
    open = true;
  }
};

}  // namespace dart

#endif  // DART_CORE_EDGE_COUNTER_H
