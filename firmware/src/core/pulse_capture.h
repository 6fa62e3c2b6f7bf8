// Measures servo pulses edge by edge (CAPTURE frames).
#ifndef DART_CORE_PULSE_CAPTURE_H
#define DART_CORE_PULSE_CAPTURE_H

#include <stdint.h>

#include "time.h"
#include "wire.h"

namespace dart {

// Fed by the capture interrupt: additions and compares only.
struct PulseCapture {
  wire::Capture result;
  uint16_t wanted;  // periods
  bool running;
  bool high;
  bool started;  // the first rise was seen

  void begin(uint16_t periods) {
    result = {0, 0, 0, 0, 0xFFFF, 0};
    wanted = periods;
    high = started = false;
    running = periods != 0;
  }

  void rise(Tick now) {
    high = true;
    if (!started) {
      started = true;
      result.first_rise = result.last_rise = now;
      return;
    }
    result.last_rise = now;
    ++result.frames;
    if (result.frames == wanted) {
      running = false;
    }
  }

  void fall(Tick now) {
    if (!high) {
      return;
    }
    high = false;
    uint16_t const width = static_cast<uint16_t>(now - result.last_rise);
    result.high_sum += width;
    if (width < result.high_min) {
      result.high_min = width;
    }
    if (width > result.high_max) {
      result.high_max = width;
    }
  }
};

}  // namespace dart

#endif  // DART_CORE_PULSE_CAPTURE_H
