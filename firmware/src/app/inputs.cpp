#include "inputs.h"

#include "../board/clock.h"
#include "../board/receiver.h"
#include "../board/supply.h"
#include "../core/battery_meter.h"
#include "../core/rc_receiver.h"
#include "state.h"

namespace dart {
namespace app {

namespace {

constexpr uint8_t kRc = static_cast<uint8_t>(wire::BeatRequest::kRc);
constexpr uint8_t kBattery =
    static_cast<uint8_t>(wire::BeatRequest::kBattery);

uint8_t requested;
RcReceiver receiver;
bool second_slot;
BatteryMeter meter;

}  // namespace

void request_inputs(Tick now, uint8_t flags) {
  uint8_t const next = flags & (kRc | kBattery);
  uint8_t const changed = static_cast<uint8_t>(next ^ requested);
  requested = next;
  if ((changed & kRc) != 0) {
    board::receiver_set((next & kRc) != 0);
    receiver.start(now, board::receiver_levels());
  }
  if ((changed & kBattery) != 0) {
    board::meter_set((next & kBattery) != 0);
    meter.start();
  }
}

void collect_pulses() {
  PinStamp stamp;
  while (board::receiver_take(stamp)) {
    // The clock is read after the stamp, which must not lie ahead of it.
    receiver.edge(extended(board::now(), stamp.at), stamp.levels);
  }
}

void inputs_slot(Tick now) {
  if (!supervisor.beat_ok(now)) {
    request_inputs(now, 0);
  }
  if (board::receiver_slot()) {
    receiver.gap(now, board::receiver_levels());
  }
  uint16_t counts;
  if ((requested & kBattery) != 0 && board::meter_poll(counts)) {
    board::meter_convert(meter.next(now, counts));
  }
}

bool rc_due() {
  second_slot = !second_slot;
  return (requested & kRc) != 0 && second_slot;
}

wire::Rc rc_frame(Tick now) { return receiver.frame(now); }

bool battery_ready() { return meter.ready(); }

wire::Battery const& battery_frame() { return meter.take(); }

}  // namespace app
}  // namespace dart
