// Pulses of an RC receiver, edge by edge: which are a command.
//
// A receiver sends one pulse of 1 to 2 ms per channel each 10 to 25 ms. Noise
// does not: a channel has a signal only after five good pulses in a row.
#ifndef DART_CORE_RC_RECEIVER_H
#define DART_CORE_RC_RECEIVER_H

#include <stdint.h>

#include "time.h"
#include "wire.h"

namespace dart {

struct RcChannel {
  Tick rise;       // newest rising edge, or the end of a time without edges
  Tick good_at;    // end of the newest good pulse
  uint16_t pulse;  // its length
  uint8_t run;     // good pulses, of which none was bad until there were five
  bool high;       // `rise` began a pulse
  bool spaced;     // and came late enough after the one before
};

class RcReceiver {
 public:
  static constexpr uint8_t kChannels = 3;
  static constexpr uint16_t kShortest = 800 * kTicksPerUs;
  static constexpr uint16_t kLongest = 2200 * kTicksPerUs;
  // Least time between two rising edges of a channel: 125 Hz.
  static constexpr Tick kLeastPeriod = ticks_of_ms(8);
  static constexpr uint8_t kRun = 5;
  // A pulse that comes later begins a new run.
  static constexpr Tick kMostGap = ticks_of_ms(100);

  // Forgets everything. `levels`: bit i is channel i.
  void start(Tick now, uint8_t levels) {
    for (uint8_t i = 0; i < kChannels; ++i) {
      channels_[i] = {now, now, 0, 0, false, false};
    }
    levels_ = levels;
    refused_ = 0;
  }

  // The pins have had `levels` since `at`.
  void edge(Tick at, uint8_t levels) {
    uint8_t const changed = static_cast<uint8_t>(levels ^ levels_);
    levels_ = levels;
    for (uint8_t i = 0; i < kChannels; ++i) {
      uint8_t const bit = static_cast<uint8_t>(1u << i);
      if ((changed & bit) != 0) {
        if ((levels & bit) != 0) {
          rise(channels_[i], at);
        } else {
          fall(channels_[i], at);
        }
      }
    }
  }

  // Edges were missed until now: pulses that have begun cannot be measured.
  void gap(Tick now, uint8_t levels) {
    for (uint8_t i = 0; i < kChannels; ++i) {
      channels_[i].rise = now;
      channels_[i].high = false;
    }
    levels_ = levels;
    ++refused_;
  }

  // At least each 1000 s, so that no age can wrap.
  wire::Rc frame(Tick now) {
    wire::Rc out;
    out.t_ck = now;
    for (uint8_t i = 0; i < kChannels; ++i) {
      RcChannel& c = channels_[i];
      Tick const age = now - c.good_at;
      if (age > kMostGap) {
        c.run = 0;
        c.good_at = now - kMostGap - 1;
      }
      out.pulse[i] = c.run == kRun ? c.pulse : uint16_t{0};
      out.age[i] = c.run == kRun ? milliseconds(age) : uint8_t{255};
    }
    out.refused = refused_;
    return out;
  }

 private:
  static void rise(RcChannel& c, Tick at) {
    c.spaced = at - c.rise >= kLeastPeriod;
    c.rise = at;
    c.high = true;
  }

  void fall(RcChannel& c, Tick at) {
    if (!c.high) {
      return;
    }
    c.high = false;
    Tick const width = at - c.rise;
    bool const good = c.spaced && width >= kShortest && width <= kLongest;
    if (!good) {
      ++refused_;
      c.run = c.run == kRun ? kRun : uint8_t{0};
      return;
    }
    if (at - c.good_at > kMostGap) {
      c.run = 0;
    }
    c.run = c.run == kRun ? kRun : static_cast<uint8_t>(c.run + 1);
    c.good_at = at;
    c.pulse = static_cast<uint16_t>(width);
  }

  // Of less than 2^19 ticks, without a 32-bit division: 2000 = 125 x 16.
  static uint8_t milliseconds(Tick age) {
    return static_cast<uint8_t>(static_cast<uint16_t>(age >> 4) / 125u);
  }

  RcChannel channels_[kChannels];
  uint8_t levels_;
  uint8_t refused_;
};

}  // namespace dart

#endif  // DART_CORE_RC_RECEIVER_H
