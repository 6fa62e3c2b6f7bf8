// Serial line to the host, both ways through rings and interrupts.
#ifndef DART_BOARD_UART_H
#define DART_BOARD_UART_H

#include <stdint.h>

#include "../core/time.h"

namespace dart {
namespace board {

// Rates that the clock gives: 500000 exactly, 115200 + 2.12 %.
enum class Baud : uint8_t { k115200, k500000 };

void uart_start(Baud baud);

// One received byte and, for a 0x00, the time at which it was received.
struct RxByte {
  uint8_t value;
  uint16_t stamp;  // low word of the time, only for value 0
};

// False when nothing is waiting. Never waits.
bool uart_read(RxByte& byte);

bool uart_waiting();

// Queues all of it or nothing; false when the ring has no room.
bool uart_write(uint8_t const* data, uint8_t size);

// The line is at rest: a byte written now begins now.
bool uart_idle();

// Writes the first byte at tick `start` on an idle line and queues the
// rest. Waits until then, at most kMaxStartWait. False when the line is
// busy.
constexpr uint16_t kMaxStartWait = 400;  // ticks
bool uart_write_at(uint8_t const* data, uint8_t size, Tick start);

// Errors since boot; they wrap.
struct UartErrors {
  uint8_t framing;
  uint8_t overrun;  // of the hardware or of the ring
};
UartErrors uart_errors();

// Bytes sent since boot, wraps (for the watchdog).
uint8_t uart_sent();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_UART_H
