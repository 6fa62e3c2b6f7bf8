#include "sleep.h"

#include <avr/interrupt.h>
#include <avr/sleep.h>

#include "clock.h"
#include "uart.h"

namespace dart {
namespace board {

void sleep_until_interrupt() {
  SMCR = 0;  // idle: every clock but the CPU's runs on
  cli();
  if (phases_waiting() || uart_waiting()) {
    sei();
    return;
  }
  SMCR = _BV(SE);
  sei();
  sleep_cpu();
  SMCR = 0;
}

}  // namespace board
}  // namespace dart
