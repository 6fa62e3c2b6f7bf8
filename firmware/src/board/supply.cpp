#include "supply.h"

#include <avr/io.h>

namespace dart {
namespace board {

namespace {

// The reference is 1.1 V +- 10 % from part to part: a trend, no voltmeter.
constexpr uint32_t kReferenceMv = 1100;
constexpr uint16_t kFullScale = 1024;
// 11 V and more: not a supply of this board, so not a measurement.
constexpr uint16_t kLeast = 100;

}  // namespace

void supply_start() {
  ADMUX = _BV(REFS0) | 0x0E;  // reference AVcc, input 1.1 V
  ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0) | _BV(ADSC);
}

uint16_t supply_mv() {
  if ((ADCSRA & _BV(ADSC)) != 0) {
    return 0;
  }
  uint16_t const counts = ADC;
  ADCSRA |= _BV(ADSC);
  if (counts < kLeast) {
    return 0;
  }
  return static_cast<uint16_t>(kReferenceMv * kFullScale / counts);
}

}  // namespace board
}  // namespace dart
