#include "slots.h"

#include "crc16.h"

namespace dart {

namespace {

constexpr uint8_t kHeader = 6;

uint8_t record_size(SlotPlace const& place) {
  return static_cast<uint8_t>(place.size + kSlotOverhead);
}

}  // namespace

bool SlotStore::good(SlotPlace const& place, uint8_t slot,
                     uint16_t& counter) const {
  uint8_t head[kHeader];
  uint16_t crc = 0xFFFF;
  uint16_t address = place.address[slot];
  // A CRC over a record and its own CRC, high byte first, is 0.
  uint8_t const checked = static_cast<uint8_t>(place.size + kHeader);
  for (uint8_t i = 0; i < checked; ++i, ++address) {
    uint8_t const byte = eeprom_.read(address);
    if (i < kHeader) {
      head[i] = byte;
    }
    crc = crc16(crc, byte);
  }
  crc = crc16(crc, eeprom_.read(static_cast<uint16_t>(address + 1)));
  crc = crc16(crc, eeprom_.read(address));
  counter = static_cast<uint16_t>(head[4] | static_cast<uint16_t>(head[5])
                                                << 8);
  uint16_t const magic = static_cast<uint16_t>(
      head[0] | static_cast<uint16_t>(head[1]) << 8);
  return magic == place.magic && head[2] == place.layout && crc == 0;
}

bool SlotStore::load() {
  SlotPlace const place = rom_read(place_);
  uint16_t counter[2] = {};
  bool const good_a = good(place, 0, counter[0]);
  bool const good_b = good(place, 1, counter[1]);
  loaded_ = good_a || good_b;
  if (!loaded_) {
    return false;
  }
  uint16_t const ahead = static_cast<uint16_t>(counter[1] - counter[0]);
  bool const newer_b = ahead - 1u < 0x7FFFu;
  current_ = good_b && (!good_a || newer_b) ? 1 : 0;
  counter_ = counter[current_];
  uint16_t address =
      static_cast<uint16_t>(place.address[current_] + kHeader);
  for (uint8_t i = 0; i < place.size; ++i) {
    data_[i] = eeprom_.read(address++);
  }
  return true;
}

uint8_t SlotStore::byte_at(SlotPlace const& place, uint8_t i) const {
  switch (i) {
    case 0:
      return static_cast<uint8_t>(place.magic);
    case 1:
      return static_cast<uint8_t>(place.magic >> 8);
    case 2:
      return place.layout;
    case 3:
      return 0;  // flags, none yet
    case 4:
      return static_cast<uint8_t>(counter_);
    case 5:
      return static_cast<uint8_t>(counter_ >> 8);
    default:
      break;
  }
  uint8_t const at = static_cast<uint8_t>(i - kHeader);
  if (at < place.size) {
    return data_[at];
  }
  return static_cast<uint8_t>(at == place.size ? crc_ : crc_ >> 8);
}

bool SlotStore::save() {
  if (saving()) {
    return false;
  }
  SlotPlace const place = rom_read(place_);
  current_ ^= 1;
  ++counter_;
  loaded_ = true;
  left_ = record_size(place);
  crc_ = 0xFFFF;
  for (uint8_t i = 0; i < place.size + kHeader; ++i) {
    crc_ = crc16(crc_, byte_at(place, i));
  }
  return true;
}

void SlotStore::step() {
  if (!saving()) {
    return;
  }
  SlotPlace const place = rom_read(place_);
  while (saving() && !eeprom_.busy()) {
    uint8_t const i = static_cast<uint8_t>(record_size(place) - left_);
    uint16_t const address =
        static_cast<uint16_t>(place.address[current_] + i);
    uint8_t const byte = byte_at(place, i);
    --left_;
    if (eeprom_.read(address) != byte) {
      eeprom_.write(address, byte);
    }
  }
}

}  // namespace dart
