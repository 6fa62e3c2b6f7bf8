#include "frame.h"

#include "crc16.h"

namespace dart {

namespace {

// Writes COBS: `code` is the place of the open block's code byte.
struct CobsWriter {
  uint8_t* code;
  uint8_t* next;

  __attribute__((always_inline)) void put(uint8_t byte) {
    if (byte == 0) {
      *code = static_cast<uint8_t>(next - code);
      code = next;
    } else {
      *next = byte;
    }
    ++next;
  }
};

// No block of 254 non-zero bytes can occur, so its rule is not needed.
static_assert(wire::kMaxRaw < 254, "COBS adds exactly one code byte");

}  // namespace

uint8_t build_frame(uint8_t* raw, uint8_t size, uint16_t seed, uint8_t* out) {
  CobsWriter cobs = {out, out + 1};
  uint16_t crc = seed;
  uint8_t const* from = raw;
  for (uint8_t left = size; left != 0; --left) {
    uint8_t const byte = *from++;
    crc = crc16(crc, byte);
    cobs.put(byte);
  }
  cobs.put(static_cast<uint8_t>(crc));
  cobs.put(static_cast<uint8_t>(crc >> 8));
  *cobs.code = static_cast<uint8_t>(cobs.next - cobs.code);
  *cobs.next = 0;
  return static_cast<uint8_t>(size + 4);
}

bool FrameParser::store(uint8_t byte) {
  if (size_ == kMaxRx) {
    dropped_ = true;
    return false;
  }
  raw_[size_++] = byte;
  return true;
}

RxEvent FrameParser::end_of_block() {
  bool const empty = !started_;
  bool const broken = left_ != 0;
  bool const too_long = dropped_;
  left_ = 0;
  started_ = dropped_ = false;
  if (too_long) {
    return RxEvent::kTooLong;
  }
  if (empty) {
    return RxEvent::kNothing;
  }
  return broken ? RxEvent::kBroken : RxEvent::kBlock;
}

// A code of 0xFF owes no zero, but its 254 bytes never fit.
static_assert(FrameParser::kMaxRx < 254, "every block but the first owes one");

RxEvent FrameParser::feed(uint8_t byte) {
  if (byte == 0) {
    return end_of_block();
  }
  if (dropped_) {
    return RxEvent::kNothing;
  }
  if (!started_) {
    started_ = true;
    size_ = 0;
  } else if (left_ != 0) {
    --left_;
    store(byte);
    return RxEvent::kNothing;
  } else if (!store(0)) {
    return RxEvent::kNothing;
  }
  left_ = static_cast<uint8_t>(byte - 1);
  return RxEvent::kNothing;
}

FrameCheck check_frame(uint8_t const* raw, uint8_t size, Frame& frame) {
  if (size < wire::kRawOverhead) {
    return FrameCheck::kLength;
  }
  for (uint8_t i = 0; i < wire::kDownCount; ++i) {
    wire::FrameSpec const spec = rom_read(wire::kDown[i]);
    if (spec.id != raw[0]) {
      continue;
    }
    if (spec.size != static_cast<uint8_t>(size - wire::kRawOverhead)) {
      return FrameCheck::kLength;
    }
    uint8_t const checked = static_cast<uint8_t>(size - 2);
    uint16_t const crc = crc16(spec.seed, raw, checked);
    uint16_t const sent = static_cast<uint16_t>(
        raw[checked] | static_cast<uint16_t>(raw[checked + 1] << 8));
    if (crc != sent) {
      return FrameCheck::kCrc;
    }
    frame = {raw[0], raw[1], raw + 2};
    return FrameCheck::kOk;
  }
  return FrameCheck::kLength;
}

}  // namespace dart
