// Option wires of the hardware cut-off: D6 (/OE), D5 and D9 (multiplexer).
//
// The interrupt side does not need the loop: beats_refresh() winds up a
// counter that the slot interrupt runs down; at zero the outputs are safe.
//
// The multiplexer is switched when our own pulse has just ended, so it can
// neither join two pulses nor lengthen one. Where channel 15 carries a pulse
// at least as long as the ESC's, D8 tells when the PCA9685's is high and the
// switch comes 3 ms later: no pulse is cut either. Without that, one pulse
// of the PCA9685 may be shortened at a switch. All within 23 ms.
//
// /OE is switched in the same way, within 3 ms: the ESC would take the rest
// of a pulse that is cut for a command, and hold it while no other follows.
#ifndef DART_BOARD_OUTPUTS_H
#define DART_BOARD_OUTPUTS_H

#include <stdint.h>

#include "../core/supervisor.h"

namespace dart {
namespace board {

// Parameter safety_out.
enum class Cutoff : uint8_t { kNone = 0, kEnable = 1, kMultiplexer = 2 };

void outputs_start(Cutoff cutoff);

// What the supervisor wants; the multiplexer follows within 23 ms.
void outputs_set(SafetyOutput const& output);

// A valid beat came: safe `limit_ms` to one slot more without another.
// Returns whether the last one had run out: the outputs are cut then.
bool beats_refresh(uint16_t limit_ms);

// With interrupts off: /OE high, own neutral to the ESC, as outputs_set.
void outputs_cut();

// From the slot interrupt, each 10 ms.
void beats_slot();

void led(bool on);

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_OUTPUTS_H
