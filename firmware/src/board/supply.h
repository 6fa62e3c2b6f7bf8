// Supply voltage, measured against the internal reference.
#ifndef DART_BOARD_SUPPLY_H
#define DART_BOARD_SUPPLY_H

#include <stdint.h>

namespace dart {
namespace board {

void supply_start();

// The last result in mV (0 = none yet); starts the next conversion (0.1 ms).
uint16_t supply_mv();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_SUPPLY_H
