// libFuzzer: any bytes into the frame parser. Laws: every block that ends is
// counted once; a block is decoded exactly when COBS says so and it fits; a
// frame that is accepted is the one and only coding of its content.
#include <string.h>

#include "../src/core/crc16.h"
#include "../src/core/rx_stats.h"
#include "fuzz.h"

using namespace dart;

namespace {

// The rule of COBS as its paper puts it, on a whole block without delimiter.
// Returns the decoded size, -1 when no encoder writes this block.
int decoded_size(uint8_t const* block, size_t size) {
  size_t at = 0;
  int raw = 0;
  while (at < size) {
    uint8_t const code = block[at];
    if (at + code > size) {
      return -1;
    }
    raw += code - 1;
    at += code;
    raw += code != 0xFF && at < size;
  }
  return raw;
}

uint16_t seed_of(uint8_t type) {
  for (wire::FrameSpec const& spec : wire::kDown) {
    if (spec.id == type) {
      return spec.seed;
    }
  }
  return 0;
}

void check_accepted(Frame const& frame, uint8_t size, uint8_t const* block,
                    size_t block_size) {
  uint8_t raw[wire::kMaxRaw] = {frame.type, frame.seq};
  uint8_t const payload = static_cast<uint8_t>(size - wire::kRawOverhead);
  memcpy(raw + 2, frame.payload, payload);
  uint8_t again[kMaxWire];
  uint8_t const written = build_frame(raw, static_cast<uint8_t>(payload + 2),
                                      seed_of(frame.type), again);
  LAW(written == block_size + 1);
  LAW(memcmp(again, block, block_size) == 0);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(uint8_t const* data, size_t size) {
  FrameParser parser;
  RxStats stats = {};
  size_t begin = 0;
  uint32_t blocks = 0;
  for (size_t i = 0; i < size; ++i) {
    Frame frame;
    RxStats const before = stats;
    bool const accepted = receive(parser, data[i], stats, frame);
    LAW(parser.size() <= FrameParser::kMaxRx);
    if (data[i] != 0) {
      LAW(!accepted && stats.ok == before.ok && stats.crc == before.crc &&
          stats.length == before.length);
      continue;
    }
    uint8_t const* block = data + begin;
    size_t const block_size = i - begin;
    begin = i + 1;
    blocks += block_size != 0;
    LAW(stats.ok + stats.crc + stats.length == static_cast<int>(blocks));
    int const raw = decoded_size(block, block_size);
    if (accepted) {
      LAW(raw == parser.size());
      check_accepted(frame, parser.size(), block, block_size);
    } else if (block_size != 0 && raw >= 0) {
      LAW(raw <= FrameParser::kMaxRx ? parser.size() == raw
                                     : stats.length == before.length + 1);
    }
  }
  return 0;
}
