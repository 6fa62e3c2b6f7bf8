// All state of the program above the interrupts: one object per concern.
#ifndef DART_APP_STATE_H
#define DART_APP_STATE_H

#include "../board/boot.h"
#include "../board/eeprom.h"
#include "../board/twi.h"
#include "../core/baud_guard.h"
#include "../core/bno055.h"
#include "../core/direction.h"
#include "../core/edge_log.h"
#include "../core/encoder.h"
#include "../core/events.h"
#include "../core/identity.h"
#include "../core/params.h"
#include "../core/rx_stats.h"
#include "../core/supervisor.h"

namespace dart {
namespace app {

// Parameters that take effect at boot, as they were then.
struct BootSettings {
  bool ring_b;
  bool wdt_reset;
  uint8_t safety_out;
};

extern board::AvrEeprom eeprom;
extern Params params;
extern Identity identity;
extern SlotStore offsets;
extern board::Twi twi;
extern Bno055 imu;
extern Encoder ring_a;
extern Encoder ring_b;
extern EdgeLog edge_log;
extern DirectionGuard direction;
extern Supervisor supervisor;
extern EventQueue events;
extern RxStats rx_stats;
extern board::BootReport boot;
extern BootSettings settings;
extern bool param_defaults;  // EEPROM had none

// Puts the parameters that count at run time into force: glitch rule, IMU
// read plan, bus clock, heartbeat limit. The others count at boot.
void apply_params();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_STATE_H
