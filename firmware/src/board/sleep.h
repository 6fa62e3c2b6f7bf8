// Idle sleep: timers, UART, TWI and edges wake the CPU.
#ifndef DART_BOARD_SLEEP_H
#define DART_BOARD_SLEEP_H

namespace dart {
namespace board {

// Sleeps until the next interrupt unless the loop has work already. The test
// and the sleep cannot be torn apart: sei takes effect after the next
// instruction, which is the sleep.
void sleep_until_interrupt();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_SLEEP_H
