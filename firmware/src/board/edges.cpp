#include "edges.h"

#include "atomic.h"
#include "clock.h"
#include "pins.h"

namespace dart {
namespace board {

namespace {

EdgeCounter ring_a;
EdgeCounter ring_b;
uint8_t first_level_a;

inline EdgeCounter& counter(Ring ring) {
  return ring == Ring::kA ? ring_a : ring_b;
}

}  // namespace

void edges_start(Ring ring, uint16_t min_ticks) {
  Atomic const lock;
  uint8_t const level = PIND;
  if (ring == Ring::kA) {
    first_level_a = level & kRingA;
    ring_a.start(level & kRingA, min_ticks);
    EICRA = static_cast<uint8_t>(EICRA | _BV(ISC00));  // both edges
    EIFR = _BV(INTF0);
    EIMSK = static_cast<uint8_t>(EIMSK | _BV(INT0));
  } else {
    ring_b.start(level & kRingB, min_ticks);
    EICRA = static_cast<uint8_t>(EICRA | _BV(ISC10));
    EIFR = _BV(INTF1);
    EIMSK = static_cast<uint8_t>(EIMSK | _BV(INT1));
  }
}

void edges_set_rule(uint16_t min_ticks) {
  Atomic const lock;
  uint8_t const level = PIND;
  ring_a.start(level & kRingA, min_ticks);
  ring_b.start(level & kRingB, min_ticks);
}

EdgeLatch edges_latch(Ring ring) {
  EdgeCounter const& c = counter(ring);
  uint8_t const newest = static_cast<uint8_t>(c.count - 1);
  uint8_t const before = static_cast<uint8_t>(newest - 1);
  return {c.count, c.stamps[newest % EdgeCounter::kKept],
          c.stamps[before % EdgeCounter::kKept]};
}

uint16_t edge_stamp(Ring ring, uint16_t n) {
  Atomic const lock;
  return counter(ring).stamps[n % EdgeCounter::kKept];
}

uint16_t edges_rejected() {
  Atomic const lock;
  return static_cast<uint16_t>(ring_a.rejects + ring_b.rejects);
}

bool edges_parity_broken() {
  Atomic const lock;
  bool const flipped = ((PIND ^ first_level_a) & kRingA) != 0;
  bool const odd = (ring_a.count & 1) != 0;
  bool const pending = (EIFR & _BV(INTF0)) != 0;
  return flipped != odd && !pending;
}

void edges_refresh() {
  uint16_t const t = now_low();
  ring_a.refresh(t);
  ring_b.refresh(t);
}

}  // namespace board
}  // namespace dart

// The stamp is read first: what follows may take as long as it likes.
ISR(INT0_vect) {
  uint16_t const t = TCNT1;
  dart::board::ring_a.edge(t, PIND & dart::board::kRingA);
}

ISR(INT1_vect) {
  uint16_t const t = TCNT1;
  dart::board::ring_b.edge(t, PIND & dart::board::kRingB);
}
