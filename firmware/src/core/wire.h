// The generated messages, their tables kept in flash.
#ifndef DART_CORE_WIRE_H
#define DART_CORE_WIRE_H

#include "rom.h"

#define DART_WIRE_ROM DART_ROM
#include "messages.h"

namespace dart {
namespace wire {

// True where a message lies in memory as it does on the wire: no padding and
// little-endian, as on an AVR. Then a copy is its packing, in half the flash
// of the byte-wise one; everywhere else the generated functions do it.
template <class M>
constexpr bool lies_as_sent() {
  return sizeof(M) == M::kSize && alignof(M) == 1 &&
         __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
}

template <class M>
inline void to_wire(M const& message, uint8_t* out) {
  if (lies_as_sent<M>()) {
    memcpy(out, &message, sizeof message);
  } else {
    pack(message, out);
  }
}

template <class M>
inline M from_wire(uint8_t const* in) {
  M message;
  if (lies_as_sent<M>()) {
    memcpy(&message, in, sizeof message);
  } else {
    unpack(in, message);
  }
  return message;
}

}  // namespace wire
}  // namespace dart

#endif  // DART_CORE_WIRE_H
