// One encoder ring as its interrupt sees it: a count and the newest stamps.
//
// Everything here is 16 bits wide so that the interrupt stays short; the
// Encoder extends count and stamps in the loop, which looks at least every
// slot, three times faster than the stamps wrap (32.77 ms).
#ifndef DART_CORE_EDGE_COUNTER_H
#define DART_CORE_EDGE_COUNTER_H

#include <stdint.h>

namespace dart {

// The glitch rule refuses an edge that comes too soon after an accepted one,
// or whose level has already gone back. A 16-bit interval would alias every
// 32.77 ms and refuse real edges of a slow wheel; so the slot interrupt opens
// the gate for good once an accepted edge is old enough.
enum class Gate : uint8_t {
  kOff = 0,     // no glitch rule
  kOpen = 1,    // the newest edge is old: any change of level counts
  kClosed = 2,  // the newest edge is less than 32.77 ms old: compare
};

// Shared with an interrupt: read it with interrupts off.
//
// |kKept| stamps kept, a power of two and at least the two that the Encoder
// needs. EDGES wants every stamp: with 8 at 2500 edges/s the loop has 3 ms.
template <uint8_t kKept>
struct EdgeCounter {
  uint16_t stamps[kKept];  // stamp of edge n at n % kKept, n from 0
  uint16_t count;          // accepted edges
  uint16_t last;           // stamp of the newest accepted edge
  uint16_t rejects;        // edges refused by the glitch rule
  uint16_t min_ticks;      // shortest interval, at most 5 ms
  uint8_t level;           // pin level after the newest accepted edge
  Gate gate;

  // The pin has changed: the time was read first, the level after it. The
  // interrupt on the board is this function in assembly (board/edges.cpp);
  // a test holds the two together.
  void edge(uint16_t now, uint8_t now_level) {
    if (gate != Gate::kOff) {
      uint16_t const interval = static_cast<uint16_t>(now - last);
      bool const soon = gate == Gate::kClosed && interval < min_ticks;
      if (soon || now_level == level) {
        ++rejects;
        return;
      }
      level = now_level;
      last = now;
      gate = Gate::kClosed;
    }
    stamps[count % kKept] = now;
    ++count;
  }

  // Called by the slot interrupt, at least every 20 ms.
  void refresh(uint16_t now) {
    if (gate == Gate::kClosed &&
        static_cast<uint16_t>(now - last) >= min_ticks) {
      gate = Gate::kOpen;
    }
  }

  // Takes the level of now as that of the newest edge. `min` = 0: no rule.
  void start(uint8_t now_level, uint16_t min) {
    level = now_level;
    min_ticks = min;
    gate = min == 0 ? Gate::kOff : Gate::kOpen;
  }
};

}  // namespace dart

#endif  // DART_CORE_EDGE_COUNTER_H
