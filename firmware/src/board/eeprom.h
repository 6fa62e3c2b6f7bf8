// EEPROM behind the interface of core/slots.h.
#ifndef DART_BOARD_EEPROM_H
#define DART_BOARD_EEPROM_H

#include "../core/slots.h"

namespace dart {
namespace board {

class AvrEeprom : public Eeprom {
 public:
  uint8_t read(uint16_t address) override;
  bool busy() override;
  void write(uint16_t address, uint8_t value) override;
};

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_EEPROM_H
