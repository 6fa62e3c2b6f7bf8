// What arrived from the host and what did not.
#ifndef DART_CORE_RX_STATS_H
#define DART_CORE_RX_STATS_H

#include <stdint.h>

#include "frame.h"

namespace dart {

struct RxStats {  // since boot, they wrap
  uint16_t ok;
  uint16_t crc;  // also COBS
  uint16_t length;
  uint16_t seq_gap;
  uint8_t next_seq;
  bool synced;

  // A frame was accepted. HELLO_REQ is the first word of a host: whatever
  // came before it is not missing.
  void accept(Frame const& frame) {
    ++ok;
    if (synced && frame.type != wire::HelloReq::kId) {
      seq_gap = static_cast<uint16_t>(
          seq_gap + static_cast<uint8_t>(frame.seq - next_seq));
    }
    synced = true;
    next_seq = static_cast<uint8_t>(frame.seq + 1);
  }

  uint16_t errors() const { return static_cast<uint16_t>(crc + length); }
};

// One byte of the host's stream; true when `frame` holds a checked frame,
// valid until the next byte.
inline bool receive(FrameParser& parser, uint8_t byte, RxStats& stats,
                    Frame& frame) {
  switch (parser.feed(byte)) {
    case RxEvent::kNothing:
      return false;
    case RxEvent::kBroken:
      ++stats.crc;
      return false;
    case RxEvent::kTooLong:
      ++stats.length;
      return false;
    case RxEvent::kBlock:
      break;
  }
  switch (check_frame(parser.raw(), parser.size(), frame)) {
    case FrameCheck::kCrc:
      ++stats.crc;
      return false;
    case FrameCheck::kLength:
      ++stats.length;
      return false;
    case FrameCheck::kOk:
      break;
  }
  stats.accept(frame);
  return true;
}

}  // namespace dart

#endif  // DART_CORE_RX_STATS_H
