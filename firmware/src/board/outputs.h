// Option wires of the hardware cut-off: D6 (/OE), D5 and D9 (multiplexer).
//
// The interrupt side does not need the loop: beats_refresh() winds up a
// counter that the slot interrupt runs down; at zero the outputs are safe.
#ifndef DART_BOARD_OUTPUTS_H
#define DART_BOARD_OUTPUTS_H

#include <stdint.h>

#include "../core/supervisor.h"

namespace dart {
namespace board {

// Parameter safety_out.
enum class Cutoff : uint8_t { kNone = 0, kEnable = 1, kMultiplexer = 2 };

void outputs_start(Cutoff cutoff);

// What the supervisor wants; the multiplexer follows at the end of our own
// pulse, so that two pulses never join.
void outputs_set(SafetyOutput const& output);

// A valid beat came: safe after `slots` slots without another.
void beats_refresh(uint8_t slots);

// With interrupts off: /OE high, own neutral to the ESC.
void outputs_cut();

// From the slot interrupt, each 10 ms.
void beats_slot();

void led(bool on);

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_OUTPUTS_H
