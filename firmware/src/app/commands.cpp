#include "commands.h"

#include "../board/boot.h"
#include "../board/clock.h"
#include "../board/outputs.h"
#include "../board/uart.h"
#include "safety.h"
#include "state.h"
#include "telemetry.h"

namespace dart {
namespace app {

namespace {

using namespace wire;

FrameParser parser;
BaudGuard baud_guard;

template <class M>
M unpacked(Frame const& frame) {
  return from_wire<M>(frame.payload);
}

void on_hello_req(Frame const& frame, Tick) {
  constexpr uint8_t kDiagAtOnce = 1;
  ask_hello(frame.seq);
  if ((unpacked<HelloReq>(frame).flags & kDiagAtOnce) != 0) {
    ask_diag();
  }
}

void on_heartbeat(Frame const& frame, Tick at) {
  heartbeat(unpacked<Heartbeat>(frame), at);
}

void on_time_ping(Frame const& frame, Tick at) {
  ask_pong(unpacked<TimePing>(frame), at);
}

void on_param_get(Frame const& frame, Tick) {
  uint16_t const id = unpacked<ParamGet>(frame).id;
  ask_param_value({id, Params::known(id) ? ParamStatus::kOk
                                         : ParamStatus::kUnknownId,
                   frame.seq});
}

// The answer to the PARAM_SET whose value is being stored.
ParamAnswer unconfirmed;

// Only Optiboot stops the watchdog after a reset; see board/boot.h.
bool dangerous(ParamSet const& set) {
  return set.id == static_cast<uint16_t>(ParamId::kWdtReset) &&
         set.value != 0 &&
         boot.bootloader != board::Bootloader::kOptiboot;
}

void on_param_set(Frame const& frame, Tick) {
  ParamSet const set = unpacked<ParamSet>(frame);
  ParamStatus const status = dangerous(set) ? ParamStatus::kOutOfRange
                                            : params.set(set.id, set.value);
  ParamAnswer const answer = {set.id, status, frame.seq};
  if (status == ParamStatus::kOk) {
    apply_params();
    unconfirmed = answer;
  } else {
    ask_param_value(answer);
  }
}

void on_reboot(Frame const& frame, Tick) {
  Reboot const reboot = unpacked<Reboot>(frame);
  if (reboot.magic != kRebootMagic) {
    return;
  }
  if (reboot.kind == static_cast<uint16_t>(RebootKind::kApplication)) {
    board::restart();
  }
  if (reboot.kind == static_cast<uint16_t>(RebootKind::kBootloader)) {
    board::restart_bootloader();
  }
}

void on_edges_req(Frame const& frame, Tick) {
  edge_log.request(unpacked<EdgesReq>(frame).frames);
}

void on_capture_req(Frame const& frame, Tick at) {
  ask_capture(unpacked<CaptureReq>(frame).frames, at);
}

struct Command {
  uint8_t type;
  void (*handler)(Frame const& frame, Tick at);
};

// In the order of wire::kDown.
constexpr Command kCommands[] DART_ROM = {
    {HelloReq::kId, on_hello_req},     {Heartbeat::kId, on_heartbeat},
    {TimePing::kId, on_time_ping},     {ParamGet::kId, on_param_get},
    {ParamSet::kId, on_param_set},     {Reboot::kId, on_reboot},
    {EdgesReq::kId, on_edges_req},     {CaptureReq::kId, on_capture_req},
};

constexpr bool all_handled(uint8_t i = 0) {
  return i == kDownCount || (kCommands[i].type == kDown[i].id &&
                             all_handled(static_cast<uint8_t>(i + 1)));
}
static_assert(sizeof kCommands / sizeof kCommands[0] == kDownCount,
              "every message from the host has a handler");
static_assert(all_handled(), "in the same order");

void dispatch(Frame const& frame, Tick at) {
  for (uint8_t i = 0; i < kDownCount; ++i) {
    Command const command = rom_read(kCommands[i]);
    if (command.type == frame.type) {
      command.handler(frame, at);
      return;
    }
  }
}

}  // namespace

void receive_frames() {
  constexpr uint8_t kMost = 255;
  board::RxByte byte;
  for (uint8_t i = 0; i < kMost && board::uart_read(byte); ++i) {
    baud_guard.byte();
    Frame frame;
    if (receive(parser, byte.value, rx_stats, frame)) {
      baud_guard.valid_frame();
      dispatch(frame, extended(board::now(), byte.stamp));
    }
  }
}

void param_stored(Tick now) {
  events.push(now, EventCode::kParamWritten, unconfirmed.id);
  ask_param_value(unconfirmed);
}

bool baud_is_wrong() {
  return baud_guard.slot(board::uart_errors().framing);
}

}  // namespace app
}  // namespace dart
