#include "receiver.h"

#include <avr/interrupt.h>
#include <avr/io.h>

#include "atomic.h"
#include "clock.h"
#include "pins.h"

namespace dart {
namespace board {

namespace {

// Changes of one slot; three channels at 100 Hz make 6. A noisy wire is
// masked until the next slot: at 100 cycles each, 1 % of the time.
constexpr uint8_t kBudget = StampRing::kSize;

StampRing ring;
uint8_t volatile budget;
bool listening;

// With interrupts off.
inline void listen() {
  budget = kBudget;
  PCIFR = _BV(PCIF0);
  PCICR = _BV(PCIE0);
}

}  // namespace

void receiver_set(bool on) {
  Atomic const lock;
  if (on == listening) {
    return;
  }
  listening = on;
  ring.taken = ring.written;
  if (on) {
    PORTB |= kReceiver;
    PCMSK0 = kReceiver;
    listen();
  } else {
    PCICR = 0;
    PORTB &= static_cast<uint8_t>(~kReceiver);
  }
}

bool receiver_take(PinStamp& out) { return ring.take(out); }

uint8_t receiver_levels() {
  return static_cast<uint8_t>((PINB & kReceiver) >> kReceiverShift);
}

bool receiver_slot() {
  Atomic const lock;
  bool const missed = listening && PCICR == 0;
  if (listening) {
    budget = kBudget;
  }
  if (missed) {
    ring.taken = ring.written;
    listen();
  }
  return missed;
}

}  // namespace board
}  // namespace dart

ISR(PCINT0_vect) {
  using namespace dart::board;
  uint16_t const at = now_low();
  uint8_t const levels = receiver_levels();
  uint8_t const left = static_cast<uint8_t>(budget - 1);
  budget = left;
  if (left == 0 || !ring.put(at, levels)) {
    PCICR = 0;
  }
}
