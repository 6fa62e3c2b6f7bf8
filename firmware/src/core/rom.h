// Constant tables that must not cost RAM: an AVR copies .rodata into it.
#ifndef DART_CORE_ROM_H
#define DART_CORE_ROM_H

#include <stdint.h>
#include <string.h>

#if defined(__AVR__)
#define DART_ROM __attribute__((__progmem__))
#else
#define DART_ROM
#endif

namespace dart {

inline uint8_t rom_byte(void const* address) {
#if defined(__AVR__)
  uint8_t value;
  __asm__("lpm %0, Z" : "=r"(value) : "z"(address));
  return value;
#else
  return *static_cast<uint8_t const*>(address);
#endif
}

// A copy of one table entry.
template <typename T>
T rom_read(T const& entry) {
  T copy;
  uint8_t const* from = reinterpret_cast<uint8_t const*>(&entry);
  uint8_t* to = reinterpret_cast<uint8_t*>(&copy);
  for (uint8_t i = 0; i < sizeof(T); ++i) {
    to[i] = rom_byte(from + i);
  }
  return copy;
}

}  // namespace dart

#endif  // DART_CORE_ROM_H
