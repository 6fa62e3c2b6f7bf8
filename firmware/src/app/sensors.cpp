#include "sensors.h"

#include "../board/atomic.h"
#include "../board/clock.h"
#include "../board/edges.h"
#include "state.h"

namespace dart {
namespace app {

namespace {

// Refused edges of one slot that are worth an EVENT: 2000 per second.
constexpr uint8_t kBurst = 20;
// One such EVENT per this many slots: three copies each, DIAG wants its turn.
constexpr uint8_t kBurstSlots = 20;
// Slots of standing before the IMU may be interrupted for its offsets.
constexpr uint8_t kQuietSlots = 200;

uint16_t collected;  // ring A's edges seen by the EDGES log
uint16_t rejected;
bool parity_was_broken;
bool reject_flag;
uint8_t standing_slots;
uint8_t burst_told;  // slots until the next may be told
ImuState imu_was = ImuState::kProbe;
uint16_t imu_errors;

void push_imu_state(Tick now, ImuState from, ImuState to) {
  events.push(now, wire::EventCode::kImu,
              static_cast<uint16_t>(static_cast<uint8_t>(from) << 8) |
                  static_cast<uint8_t>(to));
}

// Edges of a slot up to which the gyro is looked at twice: a wheel at 20 m/s
// makes 100. A line that chatters needs the time itself.
constexpr uint32_t kLookEdges = 100;
uint32_t edges_at_slot = 0;

}  // namespace

Tick latch_encoders() {
  EdgeLatch a;
  EdgeLatch b;
  Tick now;
  {
    board::Atomic const lock;
    now = board::now_locked();
    a = board::edges_latch(board::Ring::kA);
    b = board::edges_latch(board::Ring::kB);
  }
  ring_a.update(now, a);
  ring_b.update(now, b);
  return now;
}

void collect_edges() {
  uint16_t const low = static_cast<uint16_t>(ring_a.count());
  uint16_t fresh = static_cast<uint16_t>(low - collected);
  collected = low;
  if (!edge_log.active() || fresh == 0) {
    return;
  }
  if (fresh > board::kStampsA - 2) {
    edge_log.gap();  // the oldest may be overwritten while they are read
    fresh = 1;
  }
  Tick const now = board::now();
  for (uint8_t left = static_cast<uint8_t>(fresh); left != 0; --left) {
    Tick const time =
        extended(now, board::edge_stamp_a(static_cast<uint16_t>(low - left)));
    edge_log.add(ring_a.count() + 1 - left, time);
  }
}

void watch_encoder(Tick now) {
  direction.update(ring_a.count());
  if (!direction.standing()) {
    standing_slots = 0;
  } else if (standing_slots < kQuietSlots) {
    ++standing_slots;
  }
  uint16_t const rejects = board::edges_rejected();
  uint16_t const fresh = static_cast<uint16_t>(rejects - rejected);
  rejected = rejects;
  uint8_t const masked = board::edges_take_masked();
  bool const broken = board::edges_parity_broken();
  if (fresh != 0 || masked != 0 || (broken && !parity_was_broken)) {
    reject_flag = true;
  }
  parity_was_broken = broken;
  if (burst_told != 0) {
    --burst_told;
  } else if (fresh >= kBurst || masked != 0) {
    burst_told = kBurstSlots;
    events.push(now, wire::EventCode::kRejectBurst,
                static_cast<uint32_t>(masked) << 16 | fresh);
  }
}

void imu_slot(Tick now) {
  bool const quiet = standing_slots == kQuietSlots &&
                     supervisor.state() != Safety::kLive;
  edges_at_slot = ring_a.count();
  imu.slot(now, edges_at_slot, quiet);
}

void imu_look(Tick now) {
  if (ring_a.count() - edges_at_slot <= kLookEdges) {
    imu.look(now);
  }
}

void imu_step(Tick now) {
  imu.step(now);
  // Set-up, save and reset steps come and go; what counts is data or none.
  ImuState const state = imu.state();
  if (state != imu_was &&
      (state == ImuState::kRun || imu_was == ImuState::kRun ||
       state == ImuState::kBackoff)) {
    push_imu_state(now, imu_was, state);
    imu_was = state;
  }
  ImuCounters const& c = imu.counters();
  uint16_t const errors = static_cast<uint16_t>(c.nack + c.timeout);
  if (errors != imu_errors && events.empty()) {
    events.push(now, wire::EventCode::kI2c,
                static_cast<uint8_t>(imu.last_error()));
  }
  imu_errors = errors;
}

bool take_reject() {
  bool const was = reject_flag;
  reject_flag = false;
  return was;
}

}  // namespace app
}  // namespace dart
