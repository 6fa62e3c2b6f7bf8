#include "outputs.h"

#include "atomic.h"
#include "clock.h"
#include "pins.h"

namespace dart {
namespace board {

namespace {

// Neutral of every RC speed controller, each 20 ms.
constexpr uint16_t kHigh = 1500 * kTicksPerUs;
constexpr uint16_t kLow = 18500 * kTicksPerUs;
static_assert(kHigh + kLow == 20 * kTicksPerMs, "50 Hz");

// What compare A does to D9 at its next match.
constexpr uint8_t kSetAtMatch = _BV(COM1A1) | _BV(COM1A0);
constexpr uint8_t kClearAtMatch = _BV(COM1A1);

Cutoff fitted = Cutoff::kNone;
volatile bool pass_wanted;
volatile uint8_t beats_left;

inline void pulse_start() {
  OCR1A = static_cast<uint16_t>(now_low() + kHigh);
  TCCR1A = kSetAtMatch;
  TIFR1 = _BV(OCF1A);
  TIMSK1 = static_cast<uint8_t>(TIMSK1 | _BV(OCIE1A));
}

inline void select(bool pass) {
  if (pass) {
    PORTD |= kMuxSelect;
  } else {
    PORTD &= static_cast<uint8_t>(~kMuxSelect);
  }
}

// The pin has just changed by hardware.
inline void on_pulse_edge() {
  if (TCCR1A == kSetAtMatch) {
    TCCR1A = kClearAtMatch;
    OCR1A = static_cast<uint16_t>(OCR1A + kHigh);
    return;
  }
  TCCR1A = kSetAtMatch;
  OCR1A = static_cast<uint16_t>(OCR1A + kLow);
  select(pass_wanted);
}

}  // namespace

void outputs_start(Cutoff cutoff) {
  fitted = cutoff;
  if (cutoff == Cutoff::kEnable) {
    PORTD &= static_cast<uint8_t>(~kGate);
    DDRD |= kGate;
  } else if (cutoff == Cutoff::kMultiplexer) {
    PORTD &= static_cast<uint8_t>(~kMuxSelect);
    DDRD |= kMuxSelect;
    PORTB &= static_cast<uint8_t>(~kOwnPulse);
    DDRB |= kOwnPulse;
  }
}

void outputs_set(SafetyOutput const& output) {
  Atomic const lock;
  if (fitted == Cutoff::kEnable) {
    if (output.enable) {
      PORTD |= kGate;
    } else {
      PORTD &= static_cast<uint8_t>(~kGate);
    }
  } else if (fitted == Cutoff::kMultiplexer) {
    pass_wanted = output.pass;
    if (output.own_pulse && (TIMSK1 & _BV(OCIE1A)) == 0) {
      pulse_start();
    }
  }
}

void beats_refresh(uint8_t slots) { beats_left = slots; }

void outputs_cut() {
  pass_wanted = false;  // the multiplexer follows within one period
  if (fitted == Cutoff::kEnable) {
    PORTD &= static_cast<uint8_t>(~kGate);
  }
}

void beats_slot() {
  uint8_t const left = beats_left;
  if (left != 0) {
    beats_left = static_cast<uint8_t>(left - 1);
  } else {
    outputs_cut();
  }
}

void led(bool on) {
  if (on) {
    PORTB |= kLed;
  } else {
    PORTB &= static_cast<uint8_t>(~kLed);
  }
}

}  // namespace board
}  // namespace dart

ISR(TIMER1_COMPA_vect) { dart::board::on_pulse_edge(); }
