// I2C master: one interrupt step per bus event, never a wait in it. (The
// core's Wire waits for STOP inside its interrupt, with interrupts off.)
#ifndef DART_BOARD_TWI_H
#define DART_BOARD_TWI_H

#include <stdint.h>

#include "../core/bus.h"

namespace dart {
namespace board {

class Twi : public Bus {
 public:
  // Clock rate 100 to 400 kHz; takes effect with restart().
  void set_clock(uint16_t khz);

  void start_write(uint8_t address, uint8_t reg, uint8_t const* data,
                   uint8_t size) override;
  void start_read(uint8_t address, uint8_t reg, uint8_t* data,
                  uint8_t size) override;
  BusStatus poll() override;
  void abort() override;
  bool lines_low() override;
  void restart() override;
  void clear() override;
  void power(bool on) override;

 private:
  void start(uint8_t address, uint8_t reg, uint8_t* data, uint8_t size,
             bool reading);

  uint8_t bit_rate_ = 12;
};

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_TWI_H
