// EVENT frames waiting to be sent, each three times.
#ifndef DART_CORE_EVENTS_H
#define DART_CORE_EVENTS_H

#include <stdint.h>

#include "time.h"
#include "wire.h"

namespace dart {

class EventQueue {
 public:
  static constexpr uint8_t kSize = 4;
  static constexpr uint8_t kCopies = 3;

  // An event that finds the queue full is lost; the host sees a gap in
  // `count`.
  void push(Tick now, wire::EventCode code, uint32_t arg) {
    uint8_t const number = number_++;
    if (used_ == kSize) {
      return;
    }
    ring_[(first_ + used_) % kSize] = {now, static_cast<uint8_t>(code), number,
                                       arg};
    ++used_;
  }

  bool empty() const { return used_ == 0; }

  // The event to send next; not empty().
  wire::Event const& take() {
    wire::Event const& event = ring_[first_];
    if (++sent_ == kCopies) {
      sent_ = 0;
      first_ = static_cast<uint8_t>((first_ + 1) % kSize);
      --used_;
    }
    return event;  // stays until the ring comes round
  }

 private:
  wire::Event ring_[kSize] = {};
  uint8_t first_ = 0;
  uint8_t used_ = 0;
  uint8_t sent_ = 0;  // copies of the first
  uint8_t number_ = 0;
};

}  // namespace dart

#endif  // DART_CORE_EVENTS_H
