#include "encoder.h"

namespace dart {

// The interval before `last`, which ends the newest of `fresh` new edges.
uint16_t Encoder::interval_of(Tick now, Tick last, EdgeLatch const& latch,
                              uint16_t fresh) const {
  if (count_ == 0 && fresh == 1) {
    return 0;  // the first edge ever has none
  }
  if (now - updated_ > kMaxGap) {
    return kLong;  // the loop was late: stamps may have wrapped unseen
  }
  if (old_ && fresh == 1) {
    return kLong;
  }
  Tick const interval =
      fresh == 1 ? last - last_
                 : static_cast<uint16_t>(latch.last - latch.previous);
  return interval < kLong ? static_cast<uint16_t>(interval) : kLong;
}

void Encoder::update(Tick now, EdgeLatch const& latch) {
  uint16_t const fresh = static_cast<uint16_t>(latch.count - seen_);
  if (fresh != 0) {
    Tick const last = extended(now, latch.last);
    interval_ = interval_of(now, last, latch, fresh);
    last_ = last;
    count_ += fresh;
    seen_ = latch.count;
    old_ = false;
  } else if (now - last_ >= kLong) {
    old_ = true;  // remembered, because the difference wraps after 2147 s
  }
  updated_ = now;
}

}  // namespace dart
