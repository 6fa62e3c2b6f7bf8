// Which way the wheel turns: one channel cannot tell, the command can.
#ifndef DART_CORE_DIRECTION_H
#define DART_CORE_DIRECTION_H

#include <stdint.h>

#include "wire.h"

namespace dart {

// The sign of the motion is that of the command, held until the wheel has
// stopped. While the command says one thing and the edges still come from
// the other, the sign is ambiguous; it stays so until the stop, because a
// reversal without a pause between two edges cannot be seen.
class DirectionGuard {
 public:
  // Slots without an edge after which the wheel stands: 200 ms are four
  // edges of 2.06 mm at 0.04 m/s, the slowest speed worth a name.
  static constexpr uint8_t kQuietSlots = 20;

  void command(wire::Direction direction) {
    if (direction != wire::Direction::kUnknown) {
      command_ = direction;
    }
  }

  // Once per slot, with the edge count.
  void update(uint32_t count) {
    if (count != count_) {
      count_ = count;
      moving_ = kQuietSlots;
    } else if (moving_ != 0) {
      --moving_;
    }
    if (moving_ == 0 || motion_ == wire::Direction::kUnknown) {
      motion_ = command_;
      ambiguous_ = false;
    } else if (motion_ != command_) {
      ambiguous_ = true;
    }
  }

  bool ambiguous() const { return ambiguous_; }
  bool standing() const { return moving_ == 0; }

 private:
  uint32_t count_ = 0;
  uint8_t moving_ = 0;  // slots until it counts as standing
  wire::Direction command_ = wire::Direction::kUnknown;
  wire::Direction motion_ = wire::Direction::kUnknown;
  bool ambiguous_ = false;
};

}  // namespace dart

#endif  // DART_CORE_DIRECTION_H
