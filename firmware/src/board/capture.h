// Input capture on D8: pulses of a spare PCA9685 channel.
#ifndef DART_BOARD_CAPTURE_H
#define DART_BOARD_CAPTURE_H

#include <stdint.h>

#include "../core/wire.h"

namespace dart {
namespace board {

// Measures `periods` periods from the next rising edge on; 0 stops.
void capture_begin(uint16_t periods);

// Still measuring.
bool capture_running();

// Stops and returns what was measured.
wire::Capture capture_take();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_CAPTURE_H
