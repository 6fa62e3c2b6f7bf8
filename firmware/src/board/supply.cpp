#include "supply.h"

#include <avr/io.h>

namespace dart {
namespace board {

namespace {

// The reference is 1.1 V +- 10 % from part to part: a trend, no voltmeter.
constexpr uint32_t kReferenceMv = 1100;
constexpr uint16_t kFullScale = 1024;

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
  // Below 1.7 V this program does not run: more counts are no measurement.
  if (counts == 0 || counts > kFullScale * 2 / 3) {
    return 0;
  }
  return static_cast<uint16_t>(kReferenceMv * kFullScale / counts);
}

}  // namespace board
}  // namespace dart
