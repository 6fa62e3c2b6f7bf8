#include "link.h"

#include "../board/clock.h"
#include "../board/marks.h"
#include "../board/uart.h"
#include "../core/frame.h"

namespace dart {
namespace app {

namespace {

// A half frame left on the line by a reset ends with an extra delimiter; so
// does whatever noise filled a longer silence.
constexpr Tick kSilence = ticks_of_ms(50);

uint8_t seq;
Tick last_sent;
bool sent_any;
bool dropped;

// Returns the size of the frame written to `on_wire`.
uint8_t build(Outgoing& out, uint8_t type, uint16_t seed, uint8_t size,
              uint8_t* on_wire) {
  out.head[0] = type;
  out.head[1] = seq++;
  board::mark(board::Mark::kBuild);
  uint8_t const n = build_frame(
      out.head, static_cast<uint8_t>(size + sizeof out.head), seed, on_wire);
  board::mark(board::Mark::kNone);
  return n;
}

bool note(bool queued, Tick now) {
  if (queued) {
    last_sent = now;
    sent_any = true;
  } else {
    dropped = true;
  }
  return queued;
}

}  // namespace

bool send_payload(Outgoing& out, uint8_t type, uint16_t seed, uint8_t size) {
  uint8_t on_wire[1 + kMaxWire];  // room for the extra delimiter in front
  uint8_t const n = build(out, type, seed, size, on_wire + 1);
  Tick const now = board::now();
  if (!sent_any || now - last_sent > kSilence) {
    on_wire[0] = 0;
    return note(board::uart_write(on_wire, static_cast<uint8_t>(n + 1)), now);
  }
  return note(board::uart_write(on_wire + 1, n), now);
}

bool send_payload_at(Outgoing& out, uint8_t type, uint16_t seed, uint8_t size,
                     Tick start) {
  uint8_t on_wire[kMaxWire];
  uint8_t const n = build(out, type, seed, size, on_wire);
  return note(board::uart_write_at(on_wire, n, start), start);
}

bool take_dropped() {
  bool const was = dropped;
  dropped = false;
  return was;
}

}  // namespace app
}  // namespace dart
