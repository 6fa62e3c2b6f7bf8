// The I2C bus as the IMU driver sees it: nothing in here ever waits.
#ifndef DART_CORE_BUS_H
#define DART_CORE_BUS_H

#include <stdint.h>

namespace dart {

enum class BusStatus : uint8_t {
  kBusy = 0,
  kDone = 1,
  kAddressNack = 2,
  kDataNack = 3,
  kArbitration = 4,  // lost, or an illegal START or STOP was seen
  kTimeout = 5,      // set by the caller, which owns the deadline
  kStuck = 6,        // SDA or SCL low although nobody talks
};

// One transfer ("leg") at a time: write, or write + repeated start + read.
// The buffers belong to the caller and must live until poll() is not kBusy
// or abort() was called.
class Bus {
 public:
  virtual void start_write(uint8_t address, uint8_t reg, uint8_t const* data,
                           uint8_t size) = 0;
  virtual void start_read(uint8_t address, uint8_t reg, uint8_t* data,
                          uint8_t size) = 0;
  // kBusy until the STOP is out; then the result, until the next start.
  virtual BusStatus poll() = 0;
  // Ends a transfer at once; poll() is meaningless until the next start.
  virtual void abort() = 0;

  // SDA or SCL is low while no transfer runs.
  virtual bool lines_low() = 0;
  // Peripheral off and on (< 0.1 ms).
  virtual void restart() = 0;
  // Pins as GPIO: up to 9 SCL clocks until SDA is high, then STOP (0.1 ms).
  virtual void clear() = 0;
  // Supply of the IMU. Off drives SDA and SCL low as well: pulled-up lines
  // would feed the part through its protection diodes.
  virtual void power(bool on) = 0;

 protected:
  ~Bus() = default;
};

}  // namespace dart

#endif  // DART_CORE_BUS_H
