// What the host asks for.
#ifndef DART_APP_COMMANDS_H
#define DART_APP_COMMANDS_H

#include <stdint.h>

#include "../core/frame.h"
#include "../core/time.h"

namespace dart {
namespace app {

// Reads what the line has brought, at most one ring full, and carries out
// every checked frame.
void receive_frames();

// The parameter that was set last is stored: tells the host.
void param_stored(Tick now);

// True once when the line rate should be toggled. Once per slot.
bool baud_is_wrong();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_COMMANDS_H
