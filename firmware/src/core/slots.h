// Small records in EEPROM that survive a power cut in mid write: two slots,
// the older one is overwritten, the newest with a good CRC counts.
//
//   magic u16 | layout u8 | flags u8 | counter u16 | data ... | crc16 u16
#ifndef DART_CORE_SLOTS_H
#define DART_CORE_SLOTS_H

#include <stdint.h>

#include "rom.h"

namespace dart {

// One byte of EEPROM at a time; a write takes 3.4 ms.
class Eeprom {
 public:
  virtual uint8_t read(uint16_t address) = 0;
  // A write is under way: read() must not be called.
  virtual bool busy() = 0;
  virtual void write(uint16_t address, uint8_t value) = 0;

 protected:
  ~Eeprom() = default;
};

struct SlotPlace {
  uint16_t address[2];
  uint16_t magic;
  uint8_t layout;
  uint8_t size;  // bytes of data
};

// EEPROM map. Address 0 is left alone: a brown-out hits it first.
constexpr uint8_t kSlotOverhead = 8;
constexpr uint8_t kIdentitySize = 6;
constexpr uint8_t kOffsetsSize = 22;
constexpr uint8_t kParamsSize = 20;
constexpr SlotPlace kOffsetsPlace DART_ROM = {
    {0x20, 0x60}, 0x4F44, 1, kOffsetsSize};
constexpr SlotPlace kParamsPlace DART_ROM = {
    {0xA0, 0xC0}, 0x5044, 1, kParamsSize};
constexpr SlotPlace kIdentityPlace DART_ROM = {
    {0xE0, 0xF0}, 0x4944, 1, kIdentitySize};
static_assert(kOffsetsSize + kSlotOverhead <= 0x40, "0x20 to 0x60");
static_assert(kParamsSize + kSlotOverhead <= 0x20, "0xA0 to 0xC0");
static_assert(kIdentitySize + kSlotOverhead <= 0x10, "0xE0 to 0xF0");

class SlotStore {
 public:
  // |data| place.size bytes that hold the record; the owner changes them
  // only while saving() is false.
  constexpr SlotStore(Eeprom& eeprom, SlotPlace const& place, uint8_t* data)
      : eeprom_(eeprom), place_(place), data_(data) {}

  // Reads the newest good slot into the data; false, and the data as they
  // were, when there is none.
  bool load();

  // A good slot was found, or one was written since.
  bool loaded() const { return loaded_; }

  uint8_t* data() { return data_; }
  uint8_t const* data() const { return data_; }

  // Begins to write the data to the other slot. False while a write is under
  // way.
  bool save();
  bool saving() const { return left_ != 0; }
  // Nothing is left to write and no byte is under way.
  bool at_rest() { return !saving() && !eeprom_.busy(); }

  // Writes the next byte that differs if the EEPROM is free.
  void step();

 private:
  uint16_t word_at(uint16_t address) const;
  bool good(SlotPlace const& place, uint8_t slot) const;
  uint8_t byte_at(SlotPlace const& place, uint8_t i) const;

  Eeprom& eeprom_;
  SlotPlace const& place_;  // in ROM
  uint8_t* data_;
  uint16_t counter_ = 0;
  uint16_t crc_ = 0;     // of the record that is written
  uint8_t current_ = 1;  // slot that holds the newest record
  uint8_t left_ = 0;     // bytes not yet written
  bool loaded_ = false;
};

}  // namespace dart

#endif  // DART_CORE_SLOTS_H
