// The slot interrupt's own look at the heartbeat: it needs no loop.
#ifndef DART_CORE_BEAT_COUNTER_H
#define DART_CORE_BEAT_COUNTER_H

#include <stdint.h>

namespace dart {

// Wound up by a beat, runs down with the slots.
class BeatCounter {
 public:
  // n of a limit: rounded up.
  static uint8_t slots(uint16_t limit_ms) {
    return static_cast<uint8_t>((limit_ms + kSlotMs - 1) / kSlotMs);
  }

  // It runs out n to n + 1 slots after the beat: 110 to 120 ms with the
  // default, never before the supervisor trips.
  // Returns whether it had run out, so that the outputs were cut; then the
  // caller must keep interrupts off.
  bool beat(uint8_t n) {
    bool const was_out = out_;
    out_ = false;
    left_ = n;
    return was_out;
  }

  // At every slot; true: no beat came in time.
  bool slot() {
    uint8_t const left = left_;
    if (left == 0) {
      out_ = true;
      return true;
    }
    left_ = static_cast<uint8_t>(left - 1);
    return false;
  }

 private:
  static constexpr uint8_t kSlotMs = 10;
  uint8_t volatile left_ = 0;
  bool volatile out_ = false;
};

}  // namespace dart

#endif  // DART_CORE_BEAT_COUNTER_H
