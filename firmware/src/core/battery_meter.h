// Measures the divider of the battery, one conversion per slot.
//
// Supply and band gap are measured by turns, so that the supply of the Nano,
// 4.5 to 5.2 V over USB, cancels: V(A0) = 1.1 V x pin / reference.
#ifndef DART_CORE_BATTERY_METER_H
#define DART_CORE_BATTERY_METER_H

#include <stdint.h>

#include "time.h"
#include "wire.h"

namespace dart {

// What the converter is to be connected to.
enum class MeterInput : uint8_t {
  kReference,  // band gap
  kPulled,     // A0 with its pull-up on
  kPin,        // A0
};

class BatteryMeter {
 public:
  // A conversion has ended; what the next one is to measure. The first of
  // each input only charges the converter's capacitor.
  MeterInput next(Tick now, uint16_t counts) {
    uint8_t const step = step_;
    if (step == 0) {
      reference_ = pin_ = 0;
    } else if (step < 5) {
      reference_ = static_cast<uint16_t>(reference_ + counts);
    } else if (step == 6) {
      pulled_ = counts;
    } else if (step > 7) {
      pin_ = static_cast<uint16_t>(pin_ + counts);
    }
    step_ = static_cast<uint8_t>(step + 1);
    if (step_ == kSteps) {
      step_ = 0;
      result_ = {now, pin_, reference_, pulled_};
      ready_ = true;
    }
    return input(step_);
  }

  void start() {
    step_ = 0;
    ready_ = false;
  }

  bool ready() const { return ready_; }
  wire::Battery const& take() {
    ready_ = false;
    return result_;
  }

 private:
  // 5 + 2 + 5 conversions, 120 ms.
  static constexpr uint8_t kSteps = 12;

  static MeterInput input(uint8_t step) {
    return step < 5   ? MeterInput::kReference
           : step < 7 ? MeterInput::kPulled
                      : MeterInput::kPin;
  }

  wire::Battery result_;
  uint16_t reference_;
  uint16_t pin_;
  uint16_t pulled_;
  uint8_t step_;
  bool ready_;
};

}  // namespace dart

#endif  // DART_CORE_BATTERY_METER_H
