// STATE: one per slot, the clock of the host's loop.
#ifndef DART_APP_STATE_FRAME_H
#define DART_APP_STATE_FRAME_H

namespace dart {
namespace app {

// Latches the sensors and queues STATE. Error flags tell what happened since
// the last call.
void send_state();

// This slot began late.
void flag_overrun();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_STATE_FRAME_H
