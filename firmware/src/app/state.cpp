#include "state.h"

#include "../board/edges.h"

namespace dart {
namespace app {

static uint8_t offset_bytes[kOffsetsSize];

board::AvrEeprom eeprom;
Params params(eeprom);
Identity identity(eeprom);
SlotStore offsets(eeprom, kOffsetsPlace, offset_bytes);
board::Twi twi;
Bno055 imu;
Encoder ring_a;
Encoder ring_b;
EdgeLog edge_log;
DirectionGuard direction;
Supervisor supervisor(0);  // apply_params() sets the limit
EventQueue events;
RxStats rx_stats;
board::BootReport boot;
BootSettings settings;
bool param_defaults;

namespace {

uint16_t twi_khz;

}  // namespace

void apply_params() {
  uint16_t const edge_min_us =
      static_cast<uint16_t>(params.get(wire::ParamId::kEdgeMinUs));
  board::edges_set_rule(static_cast<uint16_t>(edge_min_us * kTicksPerUs));
  imu.set_plan(static_cast<uint8_t>(params.get(wire::ParamId::kImuPlan)));
  supervisor.set_limit(
      ticks_of_ms(params.get(wire::ParamId::kBeatTimeoutMs)));
  uint16_t const khz =
      static_cast<uint16_t>(params.get(wire::ParamId::kTwiKhz));
  if (khz != twi_khz) {
    twi_khz = khz;
    twi.set_clock(khz);
    twi.restart();  // a leg under way ends with its deadline
  }
}

}  // namespace app
}  // namespace dart
