// Frames to the host: sequence number, CRC, COBS, transmit ring.
#ifndef DART_APP_LINK_H
#define DART_APP_LINK_H

#include <stdint.h>

#include "../core/time.h"
#include "../core/wire.h"

namespace dart {
namespace app {

// Payload of the next frame; one frame is built at a time.
uint8_t* payload();

// Frames and queues `size` bytes of payload(). A frame that finds no room is
// dropped and flagged; its sequence number is used up, so the host counts it.
bool send_payload(uint8_t type, uint16_t seed, uint8_t size);

// As send_payload, but the first byte enters the idle line at tick `start`.
bool send_payload_at(uint8_t type, uint16_t seed, uint8_t size, Tick start);

template <class M>
bool send(M const& message) {
  wire::pack(message, payload());
  return send_payload(M::kId, M::kSeed, M::kSize);
}

// True once after a frame was dropped.
bool take_dropped();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_LINK_H
