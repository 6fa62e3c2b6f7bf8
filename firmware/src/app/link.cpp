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

uint8_t raw[wire::kMaxRaw];
uint8_t on_wire[1 + kMaxWire];  // room for the extra delimiter in front
uint8_t seq;
Tick last_sent;
bool sent_any;
bool dropped;

// Returns the size of the frame at on_wire + 1.
uint8_t build(uint8_t type, uint16_t seed, uint8_t size) {
  raw[0] = type;
  raw[1] = seq++;
  board::mark(board::Mark::kBuild);
  uint8_t const n =
      build_frame(raw, static_cast<uint8_t>(size + 2), seed, on_wire + 1);
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

uint8_t* payload() { return raw + 2; }

bool send_payload(uint8_t type, uint16_t seed, uint8_t size) {
  uint8_t const n = build(type, seed, size);
  Tick const now = board::now();
  if (!sent_any || now - last_sent > kSilence) {
    on_wire[0] = 0;
    return note(board::uart_write(on_wire, static_cast<uint8_t>(n + 1)), now);
  }
  return note(board::uart_write(on_wire + 1, n), now);
}

bool send_payload_at(uint8_t type, uint16_t seed, uint8_t size, Tick start) {
  uint8_t const n = build(type, seed, size);
  return note(board::uart_write_at(on_wire + 1, n, start), start);
}

bool take_dropped() {
  bool const was = dropped;
  dropped = false;
  return was;
}

}  // namespace app
}  // namespace dart
