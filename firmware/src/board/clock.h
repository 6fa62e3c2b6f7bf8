// Timer1: the only clock. 0.5 us per count, never written after start().
//
//   compare B   phases of the 10 ms slot (this file)
//   compare A   own servo pulse on D9 (outputs.h)
//   capture     PCA9685 pulse on D8 (capture.h)
#ifndef DART_BOARD_CLOCK_H
#define DART_BOARD_CLOCK_H

#include <avr/io.h>
#include <stdint.h>

#include "../core/time.h"

namespace dart {
namespace board {

// A slot is cut where the loop must wake without any other interrupt.
//   0      slot: latch the encoder, send STATE
//   3.5 ms IMU: the read takes 4.6 ms (mean, 180 us per byte), so its data
//          are 2 to 6 ms old when they are sent and it is never in the way
//   9.6 ms Deadline: 6 ms after the start of the read and a little
enum class Phase : uint8_t { kSlot, kImu, kDeadline };

void clock_start();

// Safe anywhere; the interrupt flag is restored.
Tick now();

// Low word of now(); with interrupts off only: the byte that latches
// TCNT1's high half is shared.
inline uint16_t now_low() { return TCNT1; }

// Time of a match `ticks` after `from`, or some ticks from now if that has
// passed: edges may hold up a timer interrupt for a millisecond, and a match
// that is missed comes with the next turn of the timer, 33 ms later. With
// interrupts off only.
inline uint16_t match_after(uint16_t from, uint16_t ticks) {
  constexpr uint8_t kMargin = 16;  // 8 us: as long as it takes to set it
  uint16_t const now = now_low();
  uint16_t const soonest = static_cast<uint16_t>(now - from + kMargin);
  return static_cast<uint16_t>(from + (soonest > ticks ? soonest : ticks));
}

// now() for callers that have interrupts off.
Tick now_locked();

// Time of the newest input capture, in its interrupt.
Tick captured();

// True once for each phase that has begun since the last call; `late` is
// the number of slots that began meanwhile and were missed.
struct PhaseEvent {
  bool slot;
  bool imu;
  uint8_t late;
};
PhaseEvent take_phases();

// With interrupts off: take_phases() has something to tell.
bool phases_waiting();

// Slots begun since boot, counted by the interrupt (for the watchdog).
uint8_t slots_begun();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_CLOCK_H
