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
  kOff = 0,     // no glitch rule: `last` is not kept
  kOpen = 1,    // the newest edge is old: any change of level counts
  kClosed = 2,  // the newest edge is less than 32.77 ms old: compare
};

// Edges that one phase of the slot may bring before its ring is masked until
// the next slot: as many as the rule can accept in the longest phase, and 16
// to refuse; at least twice what 5000 edges/s bring. A burst is served back to
// back and holds up every other interrupt: with 77 (100 us) at 115 cycles
// 0.6 ms, without the rule 255 at 80 cycles 1.3 ms.
constexpr uint16_t kLongestPhase = 12200;  // 6.1 ms
constexpr uint8_t kLeastBudget = 64;
inline uint8_t edge_budget(uint16_t min_ticks) {
  if (min_ticks == 0) {
    return 255;
  }
  uint16_t const wanted =
      static_cast<uint16_t>(kLongestPhase / min_ticks + 16);
  return wanted < kLeastBudget ? kLeastBudget
         : wanted < 255        ? static_cast<uint8_t>(wanted)
                               : uint8_t{255};
}

// Shared with an interrupt: read it with interrupts off.
//
// |kKept| stamps kept, a power of two and at least the two that the Encoder
// needs. EDGES wants every stamp: with 8 at 2500 edges/s the loop has 3 ms.
template <uint8_t kKept>
struct EdgeCounter {
  uint16_t stamps[kKept];  // stamp of edge n at n % kKept, n from 0
  uint16_t count;          // accepted edges
  uint16_t last;           // stamp of the newest accepted edge
  uint16_t rejects;        // edges refused, by the glitch rule or the budget
  uint16_t min_ticks;      // shortest interval, at most 5 ms
  uint8_t budget;          // edges that this phase may still bring
  uint8_t level;           // pin level after the newest accepted edge
  Gate gate;

  // The pin has changed: the time was read first, the level after it. The
  // interrupt on the board is this function in assembly (board/edges.cpp);
  // a test holds the two together.
  // False when the budget is used up: mask the interrupt until refill().
  bool edge(uint16_t now, uint8_t now_level) {
    --budget;
    if (budget == 0) {
      ++rejects;
      return false;
    }
    if (gate != Gate::kOff) {
      uint16_t const interval = static_cast<uint16_t>(now - last);
      bool const soon = gate == Gate::kClosed && interval < min_ticks;
      if (soon || now_level == level) {
        ++rejects;
        return true;
      }
      last = now;
      gate = Gate::kClosed;
    }
    level = now_level;
    stamps[count % kKept] = now;
    ++count;
    return true;
  }

  // Called by the phase interrupt, at least every 20 ms, with a new budget.
  void refresh(uint16_t now, uint8_t fill) {
    budget = fill;
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

  // Another rule from the next edge on. The level stays that of the newest
  // edge: one that waits to be served is not taken for a glitch.
  void set_rule(uint16_t min) {
    if (min != min_ticks) {
      start(level, min);
    }
  }
};

}  // namespace dart

#endif  // DART_CORE_EDGE_COUNTER_H
