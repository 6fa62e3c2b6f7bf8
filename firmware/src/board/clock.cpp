#include "clock.h"

#include "atomic.h"
#include "interrupts.h"

namespace dart {
namespace board {

namespace {

volatile uint16_t high_word;
volatile uint8_t slots;          // begun since boot, wraps
volatile uint8_t slots_waiting;  // begun and not taken
volatile bool imu_waiting;
Phase next_phase;

constexpr uint16_t kToImu = 7000;        // 3.5 ms
constexpr uint16_t kToDeadline = 12200;  // 6.1 ms
constexpr uint16_t kToSlot = 800;        // 0.4 ms
static_assert(kToImu + kToDeadline + kToSlot == kTicksPerSlot,
              "the phases fill the slot, so the period has no drift");
uint16_t slot_at;  // nominal begin of the slot

}  // namespace

void clock_start() {
  TCCR1A = 0;           // normal mode, pins free
  TCCR1B = _BV(CS11);   // 16 MHz / 8
  TCNT1 = 0;
  slot_at = kTicksPerMs;  // first slot after 1 ms
  OCR1B = kTicksPerMs;
  TIFR1 = _BV(TOV1) | _BV(OCF1A) | _BV(OCF1B) | _BV(ICF1);
  TIMSK1 = _BV(TOIE1) | _BV(OCIE1B);
}

// `low` was read just now, with interrupts off.
static inline Tick with_high_word(uint16_t low) {
  uint16_t high = high_word;
  if ((TIFR1 & _BV(TOV1)) != 0 && low < 0x8000) {
    ++high;  // wrapped, and the interrupt has not run yet
  }
  return (static_cast<Tick>(high) << 16) | low;
}

Tick now_locked() { return with_high_word(TCNT1); }

Tick captured() { return with_high_word(ICR1); }

Tick now() {
  Atomic const lock;
  return now_locked();
}

PhaseEvent take_phases() {
  Atomic const lock;
  uint8_t const waiting = slots_waiting;
  PhaseEvent const event = {
      waiting != 0, imu_waiting,
      static_cast<uint8_t>(waiting > 1 ? waiting - 1 : 0)};
  slots_waiting = 0;
  imu_waiting = false;
  return event;
}

bool phases_waiting() { return slots_waiting != 0 || imu_waiting; }

uint8_t slots_begun() { return slots; }

// True at the beginning of a slot.
static inline bool begin_phase() {
  Phase const phase = next_phase;
  switch (phase) {
    case Phase::kSlot:
      slots = static_cast<uint8_t>(slots + 1);
      slots_waiting = static_cast<uint8_t>(slots_waiting + 1);
      OCR1B = static_cast<uint16_t>(OCR1B + kToImu);
      next_phase = Phase::kImu;
      break;
    case Phase::kImu:
      imu_waiting = true;
      OCR1B = static_cast<uint16_t>(OCR1B + kToDeadline);
      next_phase = Phase::kDeadline;
      break;
    case Phase::kDeadline:
      // Edges may hold up an interrupt for longer than this phase lasts.
      OCR1B = match_after(slot_at, kTicksPerSlot);
      slot_at = static_cast<uint16_t>(slot_at + kTicksPerSlot);
      next_phase = Phase::kSlot;
      break;
  }
  return phase == Phase::kSlot;
}

}  // namespace board
}  // namespace dart

ISR(TIMER1_OVF_vect) {
  using dart::board::high_word;
  high_word = static_cast<uint16_t>(high_word + 1);
}

ISR(TIMER1_COMPB_vect) {
  dart::board::on_phase(dart::board::begin_phase());
}
