// Heartbeat to outputs.
#ifndef DART_APP_SAFETY_H
#define DART_APP_SAFETY_H

#include "../core/time.h"
#include "../core/wire.h"

namespace dart {
namespace app {

// Outputs as the parameters say; the supervisor leaves BOOT.
void safety_start(Tick now);

// A HEARTBEAT whose delimiter arrived at `at`.
void heartbeat(wire::Heartbeat const& beat, Tick at);

// At every wake.
void safety_step(Tick now);

}  // namespace app
}  // namespace dart

#endif  // DART_APP_SAFETY_H
