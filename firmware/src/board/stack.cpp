#include "stack.h"

#include <avr/io.h>

extern "C" uint8_t __heap_start;  // first byte behind the variables

namespace dart {
namespace board {

namespace {

constexpr uint8_t kPaint = 0xC5;
constexpr uint8_t kPiece = 64;

uint8_t const* at = &__heap_start;
uint16_t free_bytes;

}  // namespace

void stack_scan() {
  for (uint8_t i = 0; i < kPiece; ++i) {
    if (*at != kPaint) {
      free_bytes = static_cast<uint16_t>(at - &__heap_start);
      at = &__heap_start;
      return;
    }
    ++at;
  }
}

uint16_t stack_free() { return free_bytes; }

}  // namespace board
}  // namespace dart

// Paints from the end of the variables to the top, before anything is on the
// stack. In assembly: there is no stack frame to speak of yet.
extern "C" void dart_paint() __attribute__((naked, used, section(".init3")));
void dart_paint() {
  __asm__ volatile(
      "ldi r30, lo8(__heap_start) \n\t"
      "ldi r31, hi8(__heap_start) \n\t"
      "ldi r24, %[paint]          \n\t"
      "1: st Z+, r24              \n\t"
      "cpi r30, lo8(%[end])       \n\t"
      "ldi r25, hi8(%[end])       \n\t"
      "cpc r31, r25               \n\t"
      "brne 1b                    \n\t"
      :
      : [paint] "M"(0xC5), [end] "i"(RAMEND + 1));
}
