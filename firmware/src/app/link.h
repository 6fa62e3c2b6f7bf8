// Frames to the host: sequence number, CRC, COBS, transmit ring.
#ifndef DART_APP_LINK_H
#define DART_APP_LINK_H

#include <stdint.h>

#include "../core/time.h"
#include "../core/wire.h"

namespace dart {
namespace app {

// A frame before COBS: the payload is filled in by the caller, the rest by
// the functions below.
struct Outgoing {
  uint8_t head[2];  // type, seq
  uint8_t payload[wire::kMaxRaw - wire::kRawOverhead];
};

// Frames and queues `size` bytes of payload. A frame that finds no room is
// dropped and flagged; its sequence number is used up, so the host counts it.
bool send_payload(Outgoing& out, uint8_t type, uint16_t seed, uint8_t size);

// As send_payload, but the first byte enters the idle line at tick `start`.
bool send_payload_at(Outgoing& out, uint8_t type, uint16_t seed, uint8_t size,
                     Tick start);

template <class M>
bool send(M const& message) {
  Outgoing out;
  wire::to_wire(message, out.payload);
  return send_payload(out, M::kId, M::kSeed, M::kSize);
}

template <class M>
bool send_at(M const& message, Tick start) {
  Outgoing out;
  wire::to_wire(message, out.payload);
  return send_payload_at(out, M::kId, M::kSeed, M::kSize, start);
}

// True once after a frame was dropped.
bool take_dropped();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_LINK_H
