#include "supply.h"

#include <avr/io.h>

#include "pins.h"

namespace dart {
namespace board {

namespace {

// The reference is 1.1 V +- 10 % from part to part: a trend, no voltmeter.
constexpr uint32_t kReferenceMv = 1100;
constexpr uint16_t kFullScale = 1024;
// 11 V and more: not a supply of this board, so not a measurement.
constexpr uint16_t kLeast = 100;

constexpr uint8_t kBandGap = _BV(REFS0) | 0x0E;  // reference AVcc
constexpr uint8_t kA0 = _BV(REFS0);

bool metering;
MeterInput connected;
uint16_t reference;  // newest conversion of the band gap while metering

}  // namespace

void supply_start() {
  ADMUX = kBandGap;
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0) | _BV(ADSC);
}

uint16_t supply_mv() {
  uint16_t counts = reference;
  if (!metering) {
    if (!meter_poll(counts)) {
      return 0;
    }
    ADCSRA |= _BV(ADSC);
  }
  if (counts < kLeast) {
    return 0;
  }
  return static_cast<uint16_t>(kReferenceMv * kFullScale / counts);
}

void meter_set(bool on) {
  metering = on;
  reference = 0;
  meter_convert(MeterInput::kReference);
}

bool meter_poll(uint16_t& counts) {
  if ((ADCSRA & _BV(ADSC)) != 0) {
    return false;
  }
  counts = ADC;
  return true;
}

void meter_convert(MeterInput input) {
  // The last of the reference's conversions is in force: A0 comes next.
  if (connected == MeterInput::kReference && input != connected) {
    reference = ADC;
  }
  connected = input;
  if (input == MeterInput::kPulled) {
    PORTC |= kDivider;
  } else {
    PORTC &= static_cast<uint8_t>(~kDivider);
  }
  ADMUX = input == MeterInput::kReference ? kBandGap : kA0;
  ADCSRA |= _BV(ADSC);
}

}  // namespace board
}  // namespace dart
