// Changes of the pins of an RC receiver: D10, D11, D12.
#ifndef DART_BOARD_RECEIVER_H
#define DART_BOARD_RECEIVER_H

#include <stdint.h>

#include "../core/stamp_ring.h"

namespace dart {
namespace board {

// Pulls the pins up and begins to listen; off, the pins are as after reset.
void receiver_set(bool on);

// The oldest change that waits; false: none does.
bool receiver_take(PinStamp& out);

// Levels of D10 to D12, bits 0 to 2.
uint8_t receiver_levels();

// Once per slot. True: the budget of changes was used up and some are
// missing; the interrupt has just been switched on again.
bool receiver_slot();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_RECEIVER_H
