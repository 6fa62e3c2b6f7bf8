// libFuzzer: any bytes into the parser, every accepted frame unpacked.
#include <stddef.h>
#include <stdint.h>

#include "../src/core/rx_stats.h"

using namespace dart;

namespace {

template <class M>
uint8_t touch(Frame const& frame) {
  if (frame.type != M::kId) {
    return 0;
  }
  M message;
  unpack(frame.payload, message);
  uint8_t again[M::kSize];
  pack(message, again);
  return again[0];
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(uint8_t const* data, size_t size) {
  FrameParser parser;
  RxStats stats = {};
  uint8_t volatile sink = 0;
  for (size_t i = 0; i < size; ++i) {
    Frame frame;
    if (!receive(parser, data[i], stats, frame)) {
      continue;
    }
    sink = static_cast<uint8_t>(
        touch<wire::HelloReq>(frame) + touch<wire::Heartbeat>(frame) +
        touch<wire::TimePing>(frame) + touch<wire::ParamGet>(frame) +
        touch<wire::ParamSet>(frame) + touch<wire::Reboot>(frame) +
        touch<wire::EdgesReq>(frame) + touch<wire::CaptureReq>(frame));
  }
  return sink < 0;
}
