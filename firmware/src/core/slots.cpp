#include "slots.h"

#include "crc16.h"

namespace dart {

namespace {

constexpr uint8_t kHeader = 6;
constexpr uint8_t kCounter = 4;

uint8_t record_size(SlotPlace const& place) {
  return static_cast<uint8_t>(place.size + kSlotOverhead);
}

}  // namespace

uint16_t SlotStore::word_at(uint16_t address) const {
  uint8_t const low = eeprom_.read(address);
  uint8_t const high = eeprom_.read(static_cast<uint16_t>(address + 1));
  return static_cast<uint16_t>(low | static_cast<uint16_t>(high) << 8);
}

bool SlotStore::good(SlotPlace const& place, uint8_t slot) const {
  uint16_t const begin = place.address[slot];
  uint16_t const end = static_cast<uint16_t>(begin + place.size + kHeader);
  uint16_t crc = 0xFFFF;
  for (uint16_t address = begin; address != end; ++address) {
    uint8_t const byte = eeprom_.read(address);
    crc = crc16(crc, &byte, 1);
  }
  return word_at(begin) == place.magic &&
         eeprom_.read(static_cast<uint16_t>(begin + 2)) == place.layout &&
         word_at(end) == crc;
}

bool SlotStore::load() {
  SlotPlace const place = rom_read(place_);
  loaded_ = false;
  for (uint8_t slot = 0; slot < 2; ++slot) {
    if (!good(place, slot)) {
      continue;
    }
    uint16_t const counter =
        word_at(static_cast<uint16_t>(place.address[slot] + kCounter));
    if (!loaded_ || static_cast<int16_t>(counter - counter_) > 0) {
      counter_ = counter;
      current_ = slot;
      loaded_ = true;
    }
  }
  if (!loaded_) {
    return false;
  }
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
    uint8_t const byte = byte_at(place, i);
    crc_ = crc16(crc_, &byte, 1);
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
