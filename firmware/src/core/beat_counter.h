// The slot interrupt's own look at the heartbeat: it needs no loop.
#ifndef DART_CORE_BEAT_COUNTER_H
#define DART_CORE_BEAT_COUNTER_H

#include <stdint.h>

namespace dart {

// Wound up by a beat, runs down with the slots. One byte, so that the loop
// winds it up without a lock.
class BeatCounter {
 public:
  // It runs out n to n + 1 slots after the beat, n = limit in slots rounded
  // up: 110 to 120 ms with the default, never before the supervisor trips.
  void beat(uint16_t limit_ms) {
    left_ = static_cast<uint8_t>((limit_ms + kSlotMs - 1) / kSlotMs);
  }

  // At every slot; true: no beat came in time.
  bool slot() {
    uint8_t const left = left_;
    if (left == 0) {
      return true;
    }
    left_ = static_cast<uint8_t>(left - 1);
    return false;
  }

 private:
  static constexpr uint8_t kSlotMs = 10;
  uint8_t volatile left_ = 0;
};

}  // namespace dart

#endif  // DART_CORE_BEAT_COUNTER_H
