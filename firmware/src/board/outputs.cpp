#include "outputs.h"

#include "../core/beat_counter.h"
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

// From the end of our own pulse to the switch: an ESC's input filter would
// join two pulses that are only microseconds apart.
constexpr uint16_t kApart = 100 * kTicksPerUs;
// A look at the other source that is put off is made up for here: the pulse
// it saw is over (at most 2.2 ms), the next one not yet there.
constexpr uint16_t kRetry = 3000 * kTicksPerUs;

// What a match, or a forced one, does to D9.
constexpr uint8_t kSetAtMatch = _BV(COM1A1) | _BV(COM1A0);
constexpr uint8_t kClearAtMatch = _BV(COM1A1);

// 1 kohm and 100 pF before D8, and the synchroniser: 1.5 us.
constexpr uint8_t kLookCycles = 16;

Cutoff fitted = Cutoff::kNone;
volatile bool enable_requested;
bool enabled;
volatile bool pass_requested;
bool passing;
BeatCounter beats;

// What the next match is for.
enum class Step : uint8_t { kRise, kFall, kLook, kRetry };
Step step;

inline void force(uint8_t action) {
  TCCR1A = action;
  TCCR1C = _BV(FOC1A);
}

inline void pulses_start() {
  force(kClearAtMatch);
  OCR1A = static_cast<uint16_t>(now_low() + kHigh);
  TIFR1 = _BV(OCF1A);
  TIMSK1 = static_cast<uint8_t>(TIMSK1 | _BV(OCIE1A));
}

// kMuxSelect or kGate.
template <uint8_t kPin>
inline void drive(bool high) {
  if (high) {
    PORTD |= kPin;
  } else {
    PORTD &= static_cast<uint8_t>(~kPin);
  }
}

inline bool board_is_high() { return (PINB & kCapture) != 0; }

// Switches if the PCA9685's pulse is low, as far as D8 shows it: the spare
// channel, which rises with the ESC's, and only while the cut-off passes. So
// the way there is a look of 1.5 us.
template <uint8_t kPin>
inline bool switch_between_pulses(bool pass) {
  if (pass) {
    drive<kPin>(true);
    __builtin_avr_delay_cycles(kLookCycles);
  }
  bool const low = !board_is_high();
  if (low != pass) {  // off as requested, or back from a look into a pulse
    drive<kPin>(false);
  }
  return low;
}

// Switches /OE, or kRetry later if that would cut a pulse of the PCA9685.
inline void enable_follow() {
  bool const waits = (TIMSK1 & _BV(OCIE1A)) != 0;
  if (enable_requested == enabled || waits) {
    return;
  }
  if (switch_between_pulses<kGate>(enable_requested)) {
    enabled = enable_requested;
    return;
  }
  OCR1A = static_cast<uint16_t>(now_low() + kRetry);
  TIFR1 = _BV(OCF1A);
  TIMSK1 = static_cast<uint8_t>(TIMSK1 | _BV(OCIE1A));
}

// Switches in any case: D8 may not be wired, and the wait has a bound.
inline void enable_retry() {
  TIMSK1 = static_cast<uint8_t>(TIMSK1 & ~_BV(OCIE1A));
  enabled = enable_requested;
  drive<kGate>(enabled);
}

inline void wait(uint16_t ticks, Step next) {
  OCR1A = match_after(OCR1A, ticks);
  step = next;
}

// Our own pulse has just ended, or kApart ago, or kApart + kRetry. The last
// time it switches whatever D8 says: it may not be wired, and the wait has a
// bound.
inline void after_pulse() {
  bool const want = pass_requested;
  if (step == Step::kFall) {
    if (want != passing) {
      wait(kApart, Step::kLook);
    } else {
      wait(kLow, Step::kRise);
    }
    return;
  }
  bool const last = step == Step::kRetry;
  if (want != passing) {
    if (last) {
      drive<kMuxSelect>(want);
    } else if (!switch_between_pulses<kMuxSelect>(want)) {
      wait(kRetry, Step::kRetry);
      return;
    }
    passing = want;
  }
  wait(last ? kLow - kApart - kRetry : kLow - kApart, Step::kRise);
}

// The pulse begins here and ends by hardware: however late the next
// interrupt is, no pulse is longer than it should be.
inline void begin_pulse() {
  uint16_t const now = now_low();
  force(kSetAtMatch);
  TCCR1A = kClearAtMatch;
  OCR1A = static_cast<uint16_t>(now + kHigh);
  step = Step::kFall;
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
    enable_requested = output.enable;
    enable_follow();
  } else if (fitted == Cutoff::kMultiplexer) {
    pass_requested = output.pass;
    if (output.own_pulse && (TIMSK1 & _BV(OCIE1A)) == 0) {
      pulses_start();
    }
  }
}

bool beats_refresh(uint16_t limit_ms) {
  uint8_t const slots = BeatCounter::slots(limit_ms);  // 200 cycles
  Atomic const lock;
  return beats.beat(slots);
}

void outputs_cut() {
  pass_requested = false;  // the multiplexer follows within one period
  enable_requested = false;
  if (fitted == Cutoff::kEnable) {
    enable_follow();
  }
}

void beats_slot() {
  if (beats.slot()) {
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

ISR(TIMER1_COMPA_vect) {
  using namespace dart::board;
  if (fitted == Cutoff::kEnable) {
    enable_retry();
  } else if (step == Step::kRise) {
    begin_pulse();
  } else {
    after_pulse();
  }
}
