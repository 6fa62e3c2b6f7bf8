// Who this board is: an id made once, and how often it has booted.
#ifndef DART_CORE_IDENTITY_H
#define DART_CORE_IDENTITY_H

#include <stdint.h>

#include "slots.h"

namespace dart {

class Identity {
 public:
  explicit constexpr Identity(Eeprom& eeprom)
      : store_(eeprom, kIdentityPlace, record_) {}

  // Reads EEPROM; false: this board has no id yet, call make().
  bool load() { return store_.load(); }

  // Takes an id of 32 random bits and starts to count boots.
  void make(uint32_t id);

  // Counts this boot and begins to write.
  void count_boot();

  uint32_t board_id() const;
  uint16_t boot_count() const;
  // crc16(board_id, boot_count): the arm token of this boot.
  uint16_t nonce() const;

  SlotStore& store() { return store_; }

 private:
  SlotStore store_;
  uint8_t record_[kIdentitySize] = {};  // board_id u32, boot_count u16
};

}  // namespace dart

#endif  // DART_CORE_IDENTITY_H
