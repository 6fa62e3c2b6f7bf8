#include "safety.h"

#include "../board/outputs.h"
#include "inputs.h"
#include "state.h"

namespace dart {
namespace app {

namespace {

void step_once(Tick now, bool& changed) {
  Safety const before = supervisor.state();
  changed = supervisor.step(now);
  if (changed) {
    Safety const after = supervisor.state();
    board::outputs_set(supervisor.output());
    board::led(after == Safety::kLinked || after == Safety::kLive);
    events.push(now, wire::EventCode::kSupervisor,
                static_cast<uint16_t>(static_cast<uint8_t>(before) << 8) |
                    static_cast<uint8_t>(after));
  }
}

}  // namespace

void safety_start(Tick now) {
  board::outputs_start(static_cast<board::Cutoff>(settings.safety_out));
  supervisor.set_ready();
  safety_step(now);
}

void heartbeat(wire::Heartbeat const& beat, Tick at) {
  if (beat.mode > static_cast<uint8_t>(wire::BeatMode::kStop)) {
    return;  // not a beat of this protocol
  }
  constexpr uint8_t kDirectionBits = 3;
  direction.command(
      static_cast<wire::Direction>(beat.flags & kDirectionBits));
  request_inputs(at, beat.flags);
  // The slot interrupt may have cut the outputs before the loop came to this
  // beat, although the beat itself arrived in time.
  if (board::beats_refresh(
          static_cast<uint16_t>(params.get(wire::ParamId::kBeatTimeoutMs)))) {
    supervisor.lose();
  }
  safety_step(at);  // a beat that was missed first
  supervisor.beat(at, static_cast<wire::BeatMode>(beat.mode),
                  beat.arm_token == identity.nonce());
  safety_step(at);
}

void safety_step(Tick now) {
  bool changed = true;
  // Longest chain: BOOT, IDLE, LINKED, LIVE.
  for (uint8_t i = 0; i < kSafetyStates && changed; ++i) {
    step_once(now, changed);
  }
}

}  // namespace app
}  // namespace dart
