// Every frame but STATE: one per slot at most, behind it.
#ifndef DART_APP_TELEMETRY_H
#define DART_APP_TELEMETRY_H

#include <stdint.h>

#include "../core/frame.h"
#include "../core/time.h"

namespace dart {
namespace app {

// Queues the most urgent frame that waits, if any.
void send_next(Tick now);

// Sends a waiting TIME_PONG if the line is at rest. At every wake.
void send_pong();

void ask_hello(uint8_t req_seq);
void ask_diag();
void ask_capture(uint16_t periods, Tick now);
// Answer to PARAM_GET or PARAM_SET; the value is looked up when it is sent.
struct ParamAnswer {
  uint16_t id;
  wire::ParamStatus status;
  uint8_t req_seq;
};
// False when two answers wait already; the host asks again.
bool ask_param_value(ParamAnswer const& answer);
void ask_pong(wire::TimePing const& ping, Tick received);

// A late slot, and how long a cycle took, for STATE and DIAG.
void note_overrun(Tick now, uint8_t missed);
void note_cycle(Tick length);

}  // namespace app
}  // namespace dart

#endif  // DART_APP_TELEMETRY_H
