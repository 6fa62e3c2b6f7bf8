// One encoder ring as the host sees it: 32-bit count, time of the last edge,
// interval before it.
#ifndef DART_CORE_ENCODER_H
#define DART_CORE_ENCODER_H

#include <stdint.h>

#include "time.h"

namespace dart {

// What is copied from an EdgeCounter with interrupts off.
struct EdgeLatch {
  uint16_t count;
  uint16_t last;      // stamp of edge count - 1
  uint16_t previous;  // stamp of edge count - 2
};

class Encoder {
 public:
  // enc_dt_ck: an interval that does not fit 16 bits.
  static constexpr uint16_t kLong = 65535;
  // update() must be called more often than this for exact stamps: a stamp
  // wraps after 32.77 ms.
  static constexpr Tick kMaxGap = 30 * kTicksPerMs;

  // `latch` was taken at `now`.
  void update(Tick now, EdgeLatch const& latch);

  uint32_t count() const { return count_; }
  // Time of the last edge; 0 before the first.
  Tick last() const { return last_; }
  // Interval before the last edge [ticks]: kLong when longer than 32.8 ms,
  // 0 with fewer than two edges.
  uint16_t interval() const { return interval_; }

 private:
  uint16_t interval_of(Tick now, Tick last, EdgeLatch const& latch,
                       uint16_t fresh) const;

  uint32_t count_ = 0;
  Tick last_ = 0;
  Tick updated_ = 0;
  uint16_t seen_ = 0;
  uint16_t interval_ = 0;
  bool old_ = false;  // the last edge lies too far back for an interval
};

}  // namespace dart

#endif  // DART_CORE_ENCODER_H
