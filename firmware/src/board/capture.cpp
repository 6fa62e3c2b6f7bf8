#include "capture.h"

#include "../core/pulse_capture.h"
#include "atomic.h"
#include "clock.h"

namespace dart {
namespace board {

namespace {

PulseCapture capture;

inline void expect_rise() {
  TCCR1B = _BV(ICNC1) | _BV(ICES1) | _BV(CS11);
  TIFR1 = _BV(ICF1);  // the change of edge may have set it
}

inline void expect_fall() {
  TCCR1B = _BV(ICNC1) | _BV(CS11);
  TIFR1 = _BV(ICF1);
}

inline void stop() {
  TIMSK1 = static_cast<uint8_t>(TIMSK1 & ~_BV(ICIE1));
}

}  // namespace

void capture_begin(uint16_t periods) {
  Atomic const lock;
  stop();
  capture.begin(periods);
  if (capture.running) {
    expect_rise();
    TIMSK1 = static_cast<uint8_t>(TIMSK1 | _BV(ICIE1));
  }
}

bool capture_running() { return capture.running; }

wire::Capture capture_take() {
  {
    Atomic const lock;
    stop();
    capture.running = false;
  }
  if (capture.result.frames == 0) {
    capture.result.high_min = 0;
  }
  return capture.result;
}

}  // namespace board
}  // namespace dart

ISR(TIMER1_CAPT_vect) {
  using namespace dart::board;
  dart::Tick const t = captured();
  if ((TCCR1B & _BV(ICES1)) != 0) {
    expect_fall();
    capture.rise(t);
    if (!capture.running) {
      stop();
    }
  } else {
    expect_rise();
    capture.fall(t);
  }
}
