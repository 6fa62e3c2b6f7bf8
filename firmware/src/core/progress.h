// What must move on before the watchdog is fed.
#ifndef DART_CORE_PROGRESS_H
#define DART_CORE_PROGRESS_H

#include <stdint.h>

namespace dart {

// Two counters that wrap; one that stands still is a part that is dead.
class Progress {
 public:
  void start(uint8_t slots, uint8_t sent) {
    slots_ = slots;
    sent_ = sent;
  }

  // Both have moved since the last call.
  bool made(uint8_t slots, uint8_t sent) {
    bool const both = slots != slots_ && sent != sent_;
    start(slots, sent);
    return both;
  }

 private:
  uint8_t slots_ = 0;
  uint8_t sent_ = 0;
};

}  // namespace dart

#endif  // DART_CORE_PROGRESS_H
