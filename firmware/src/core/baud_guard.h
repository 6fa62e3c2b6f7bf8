// Decides when the line rate must be wrong.
#ifndef DART_CORE_BAUD_GUARD_H
#define DART_CORE_BAUD_GUARD_H

#include <stdint.h>

namespace dart {

// In windows of 3 s: framing errors or many bytes, but no valid frame.
class BaudGuard {
 public:
  static constexpr uint16_t kWindowSlots = 300;
  static constexpr uint8_t kFramingErrors = 20;
  // A host that knocks sends 12 bytes each 100 ms: 360 in a window. Bytes
  // count beside the errors, because a wrong rate may keep its framing.
  static constexpr uint8_t kBytes = 100;

  void byte() {
    if (bytes_ <= kBytes) {
      ++bytes_;
    }
  }
  void valid_frame() { valid_ = true; }

  // Once per slot, with the framing errors since boot. True: toggle now.
  bool slot(uint8_t framing_errors) {
    if (++slots_ < kWindowSlots) {
      return false;
    }
    uint8_t const errors =
        static_cast<uint8_t>(framing_errors - framing_before_);
    bool const wrong =
        !valid_ && (errors > kFramingErrors || bytes_ > kBytes);
    framing_before_ = framing_errors;
    slots_ = 0;
    bytes_ = 0;
    valid_ = false;
    return wrong;
  }

 private:
  uint16_t slots_ = 0;
  uint8_t bytes_ = 0;  // no more than tell
  uint8_t framing_before_ = 0;
  bool valid_ = false;
};

}  // namespace dart

#endif  // DART_CORE_BAUD_GUARD_H
