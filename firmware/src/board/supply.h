// The converter: supply voltage against the internal reference, and the
// divider of the battery on A0.
#ifndef DART_BOARD_SUPPLY_H
#define DART_BOARD_SUPPLY_H

#include <stdint.h>

#include "../core/battery_meter.h"

namespace dart {
namespace board {

void supply_start();

// The last result in mV (0 = none yet); starts the next conversion (0.1 ms)
// unless the battery is measured, which does so all the time.
uint16_t supply_mv();

// Measures A0 as well, from the band gap on; off: as after supply_start().
void meter_set(bool on);

// The result of the conversion that was started last; false: it runs.
bool meter_poll(uint16_t& counts);

// Starts a conversion of 0.1 ms.
void meter_convert(MeterInput input);

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_SUPPLY_H
