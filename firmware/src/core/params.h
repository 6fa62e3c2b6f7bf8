// The parameters of wire.h, kept in EEPROM.
#ifndef DART_CORE_PARAMS_H
#define DART_CORE_PARAMS_H

#include <stdint.h>

#include "slots.h"
#include "wire.h"

namespace dart {

class Params {
 public:
  explicit constexpr Params(Eeprom& eeprom)
      : store_(eeprom, kParamsPlace, values_) {}

  // Reads EEPROM; false: defaults are in force.
  bool load();

  // Value now in force. Unknown ids give 0; see known().
  uint32_t get(wire::ParamId id) const;
  static bool known(uint16_t id);

  // Checks, puts in force and begins to write. Nothing changes unless the
  // result is kOk; an equal value costs no write. kEepromBusy until the
  // value before is stored.
  wire::ParamStatus set(uint16_t id, uint32_t value);

  // Writes on. True once after each kOk: the last byte is stored, a value
  // that a host is told survives what comes now.
  bool step();

  // CRC of the values in force (HELLO.param_crc).
  uint16_t crc() const;

 private:
  static bool allowed(wire::ParamSpec const& spec, uint32_t value);
  void set_defaults();

  SlotStore store_;
  uint8_t values_[kParamsSize] = {};  // u16 each, little-endian
  bool unconfirmed_ = false;
};
static_assert(kParamsSize == 2 * wire::kParamCount, "two bytes each");

}  // namespace dart

#endif  // DART_CORE_PARAMS_H
