// Encoder rings and IMU, as the loop serves them.
#ifndef DART_APP_SENSORS_H
#define DART_APP_SENSORS_H

#include <stdint.h>

#include "../core/time.h"

namespace dart {
namespace app {

// Takes over what the interrupts have counted; returns the time at which
// that was true. Cheap: called at every wake.
Tick latch_encoders();

// Hands new edges of ring A to the EDGES log, if one is asked for.
void collect_edges();

// Once per slot: direction, parity, bursts of refused edges.
void watch_encoder(Tick now);

// Once per slot, 3.5 ms after its start: begins the IMU's reads.
void imu_slot(Tick now);

// Once per slot, after its STATE: looks whether the gyro has new data.
void imu_look(Tick now);

// At every wake: moves the IMU's machine on and reports what changed.
void imu_step(Tick now);

// True once if edges were refused, or the count does not fit the pin's
// level, since the last call.
bool take_reject();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_SENSORS_H
