#include "identity.h"

#include "crc16.h"
#include "wire.h"

namespace dart {

using wire::detail::get;
using wire::detail::put;

uint32_t Identity::board_id() const {
  uint32_t id;
  get(record_, id);
  return id;
}

uint16_t Identity::boot_count() const {
  uint16_t count;
  get(record_ + 4, count);
  return count;
}

void Identity::make(uint32_t id) {
  // An id of all zeros or ones would look like a fresh EEPROM.
  put(record_, id == 0 || id == 0xFFFFFFFF ? uint32_t{0xDA27DA27} : id);
  put(record_ + 4, uint16_t{0});
}

void Identity::count_boot() {
  put(record_ + 4, static_cast<uint16_t>(boot_count() + 1));
  store_.save();
}

uint16_t Identity::nonce() const {
  return crc16(0xFFFF, record_, kIdentitySize);
}

}  // namespace dart
