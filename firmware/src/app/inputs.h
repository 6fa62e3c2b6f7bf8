// What a heartbeat may request: RC receiver and battery.
#ifndef DART_APP_INPUTS_H
#define DART_APP_INPUTS_H

#include <stdint.h>

#include "../core/time.h"
#include "../core/wire.h"

namespace dart {
namespace app {

// Flags of the newest HEARTBEAT: BeatRequest.
void request_inputs(Tick now, uint8_t flags);

// At every wake: takes the receiver's edges.
void collect_pulses();

// Once per slot; without a heartbeat nothing is measured.
void inputs_slot(Tick now);

// RC is due in this slot: every second one while it is requested.
bool rc_due();
wire::Rc rc_frame(Tick now);

bool battery_ready();
wire::Battery const& battery_frame();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_INPUTS_H
