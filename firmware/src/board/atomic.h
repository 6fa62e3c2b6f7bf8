// Interrupts off for the life of the object.
#ifndef DART_BOARD_ATOMIC_H
#define DART_BOARD_ATOMIC_H

#include <avr/interrupt.h>
#include <avr/io.h>

#include "marks.h"

namespace dart {
namespace board {

// Keep the block below 200 cycles: that is 12.5 us of edge stamp error.
class Atomic {
 public:
  __attribute__((always_inline)) Atomic() : sreg_(SREG) {
    cli();
    mark(Mark::kAtomic);
  }
  __attribute__((always_inline)) ~Atomic() {
    mark(Mark::kNone);
    // The compiler must not move what the block reads past its end.
    __asm__ volatile("" ::: "memory");
    SREG = sreg_;
  }
  Atomic(Atomic const&) = delete;
  Atomic& operator=(Atomic const&) = delete;

 private:
  uint8_t sreg_;
};

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_ATOMIC_H
