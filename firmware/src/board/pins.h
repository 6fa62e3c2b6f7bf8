// Wiring of the car, Nano pin by pin (ATmega328P names in brackets).
#ifndef DART_BOARD_PINS_H
#define DART_BOARD_PINS_H

#include <avr/io.h>
#include <stdint.h>

namespace dart {
namespace board {

constexpr uint8_t kRingA = _BV(PD2);      // D2 [INT0] IR sensor
constexpr uint8_t kRingB = _BV(PD3);      // D3 [INT1] Hall sensor, option
constexpr uint8_t kImuPower = _BV(PD4);   // D4 supplies the BNO055
constexpr uint8_t kMuxSelect = _BV(PD5);  // D5 1 = PCA9685 drives the ESC
constexpr uint8_t kGate = _BV(PD6);       // D6 MOSFET that pulls /OE low
constexpr uint8_t kIrPower = _BV(PD7);    // D7 supplies the IR sensor
constexpr uint8_t kCapture = _BV(PB0);    // D8 [ICP1] spare PCA9685 channel
constexpr uint8_t kOwnPulse = _BV(PB1);   // D9 [OC1A] own neutral pulse
// D10 to D12 [PCINT2 to 4] RC receiver, option: steering, throttle, mode
constexpr uint8_t kReceiver = _BV(PB2) | _BV(PB3) | _BV(PB4);
constexpr uint8_t kReceiverShift = PB2;
constexpr uint8_t kLed = _BV(PB5);        // D13 state LED
constexpr uint8_t kDivider = _BV(PC0);    // A0 divider of the battery, option
constexpr uint8_t kSda = _BV(PC4);        // A4
constexpr uint8_t kScl = _BV(PC5);        // A5

// Sensors powered, ring inputs pulled up, everything else as after reset.
inline void pins_start() {
  PORTD |= kRingA | kRingB | kImuPower | kIrPower;
  DDRD |= kImuPower | kIrPower;
  PORTB |= kCapture;
  DDRB |= kLed;
}

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_PINS_H
