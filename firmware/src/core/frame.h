// Frames: COBS(type u8 | seq u8 | payload | crc16 u16) 0x00.
#ifndef DART_CORE_FRAME_H
#define DART_CORE_FRAME_H

#include <stdint.h>

#include "wire.h"

namespace dart {

// Longest frame on the wire: COBS adds one code byte below 254 raw bytes,
// the delimiter is one more.
constexpr uint8_t kMaxWire = wire::kMaxRaw + 2;

// Appends the CRC to `raw` and writes its COBS form and the delimiter to
// `out`, in one pass over the bytes (an AVR pays for every load).
//
// |raw|  type, seq and payload; room for 2 more bytes behind |size|
// |size| 2 to kMaxRaw - 2
// |seed| CRC start of this message
// |out|  size + 4 bytes
// Returns the bytes written: always size + 4.
uint8_t build_frame(uint8_t* raw, uint8_t size, uint16_t seed, uint8_t* out);

// What became of the bytes so far.
enum class RxEvent : uint8_t {
  kNothing,  // inside a block, or an empty one
  kBlock,    // a block is decoded: see raw() and size()
  kBroken,   // COBS says otherwise
  kTooLong,  // more than kMaxRx raw bytes
};

// Takes one byte at a time; a 0x00 ends every trouble. No allocation, no
// look-ahead, so a frame is there with its own delimiter.
class FrameParser {
 public:
  // Half as much again as the longest frame to the Nano.
  static constexpr uint8_t kMaxRx = 20;

  RxEvent feed(uint8_t byte);

  // Valid after kBlock until the next feed().
  uint8_t const* raw() const { return raw_; }
  uint8_t size() const { return size_; }

 private:
  RxEvent end_of_block();
  bool store(uint8_t byte);

  uint8_t raw_[kMaxRx] = {};
  uint8_t size_ = 0;
  uint8_t left_ = 0;      // bytes until the next code byte
  bool started_ = false;  // a code byte was seen
  bool dropped_ = false;  // too long: ignore up to the delimiter
};

// A checked frame from the host.
struct Frame {
  uint8_t type;
  uint8_t seq;
  uint8_t const* payload;
};

enum class FrameCheck : uint8_t { kOk, kLength, kCrc };

// Checks type, length and CRC of a decoded block against what the Nano
// accepts. `frame` is filled only with kOk and points into `raw`.
FrameCheck check_frame(uint8_t const* raw, uint8_t size, Frame& frame);

}  // namespace dart

#endif  // DART_CORE_FRAME_H
