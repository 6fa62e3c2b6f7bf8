#include "eeprom.h"

#include "atomic.h"

namespace dart {
namespace board {

uint8_t AvrEeprom::read(uint16_t address) {
  EEAR = address;
  EECR = _BV(EERE);
  return EEDR;
}

bool AvrEeprom::busy() { return (EECR & _BV(EEPE)) != 0; }

void AvrEeprom::write(uint16_t address, uint8_t value) {
  EEAR = address;
  EEDR = value;
  Atomic const lock;  // EEPE must follow EEMPE within four cycles
  EECR = _BV(EEMPE);
  EECR |= _BV(EEPE);
}

}  // namespace board
}  // namespace dart
