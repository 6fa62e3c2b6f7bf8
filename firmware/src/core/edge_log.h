// EDGES frames: eight successive intervals, for learning the ring.
#ifndef DART_CORE_EDGE_LOG_H
#define DART_CORE_EDGE_LOG_H

#include <stdint.h>

#include "encoder.h"
#include "time.h"
#include "wire.h"

namespace dart {

class EdgeLog {
 public:
  static constexpr uint8_t kIntervals = 8;

  // `frames` frames from the next edge on; 0 stops.
  void request(uint16_t frames) {
    wanted_ = frames;
    filled_ = 0;
    primed_ = ready_ = false;
  }

  bool active() const { return wanted_ != 0; }

  // Edges were missed: begin a new frame.
  void gap() {
    filled_ = 0;
    primed_ = false;
  }

  // Each edge in order: enc_count after it, and its time.
  void add(uint32_t count, Tick time) {
    if (primed_ && active()) {
      store(count, time);
    }
    primed_ = true;
    last_ = time;
  }

  // A frame is complete: send frame(), then sent().
  bool ready() const { return ready_; }
  wire::Edges const& frame() const { return done_; }
  void sent() { ready_ = false; }

 private:
  void store(uint32_t count, Tick time) {
    Tick const interval = time - last_;
    if (filled_ == 0) {
      filling_.first_count = count;
    }
    filling_.interval[filled_++] = interval < Encoder::kLong
                                       ? static_cast<uint16_t>(interval)
                                       : Encoder::kLong;
    if (filled_ < kIntervals) {
      return;
    }
    filled_ = 0;
    if (!ready_) {  // else the line is too slow: this frame is skipped whole
      filling_.t_ck = time;
      done_ = filling_;
      ready_ = true;
      --wanted_;
    }
  }

  wire::Edges filling_ = {};
  wire::Edges done_ = {};
  Tick last_ = 0;
  uint16_t wanted_ = 0;  // frames still to fill
  uint8_t filled_ = 0;
  bool primed_ = false;  // last_ is the edge before the next
  bool ready_ = false;
};

}  // namespace dart

#endif  // DART_CORE_EDGE_LOG_H
