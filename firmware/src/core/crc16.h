// CRC-16 CCITT: polynomial 0x1021, not reflected, no final xor.
// "123456789" from 0xFFFF gives 0x29B1.
#ifndef DART_CORE_CRC16_H
#define DART_CORE_CRC16_H

#include <stddef.h>
#include <stdint.h>

namespace dart {

// One byte without a table. With x = (high byte ^ data), folded once, the
// eight polynomial steps are crc << 8 ^ x << 12 ^ x << 5 ^ x; written per
// byte because an 8-bit CPU shifts a word bit by bit.
__attribute__((always_inline)) inline uint16_t crc16(uint16_t crc,
                                                     uint8_t data) {
  uint8_t x = static_cast<uint8_t>((crc >> 8) ^ data);
  x = static_cast<uint8_t>(x ^ (x >> 4));
  uint8_t const high = static_cast<uint8_t>(
      static_cast<uint8_t>(crc) ^ static_cast<uint8_t>(x << 4) ^ (x >> 3));
  uint8_t const low = static_cast<uint8_t>(x ^ static_cast<uint8_t>(x << 5));
  return static_cast<uint16_t>(static_cast<uint16_t>(high << 8) | low);
}

inline uint16_t crc16(uint16_t crc, uint8_t const* data, size_t size) {
  for (size_t i = 0; i < size; ++i) {
    crc = crc16(crc, data[i]);
  }
  return crc;
}

}  // namespace dart

#endif  // DART_CORE_CRC16_H
