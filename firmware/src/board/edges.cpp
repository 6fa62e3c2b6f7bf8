#include "edges.h"

#include "../core/edge_counter.h"
#include "atomic.h"
#include "clock.h"
#include "pins.h"

namespace dart {
namespace board {

namespace {

constexpr uint8_t kKeptA = kStampsA;
constexpr uint8_t kKeptB = 2;
EdgeCounter<kKeptA> ring_a;
EdgeCounter<kKeptB> ring_b;
uint8_t first_level_a;
uint8_t fitted;  // bits of EIMSK
uint8_t budget = edge_budget(0);
volatile uint8_t masked;  // bits of EIMSK, since they were taken
static_assert(_BV(INT0) == 1 && _BV(INT1) == 2, "edges_take_masked()");

template <uint8_t kKept>
inline EdgeLatch latch(EdgeCounter<kKept> const& c) {
  uint8_t const newest = static_cast<uint8_t>(c.count - 1);
  uint8_t const before = static_cast<uint8_t>(newest - 1);
  return {c.count, c.stamps[newest % kKept], c.stamps[before % kKept]};
}

// EdgeCounter::edge() by hand: avr-gcc saves 13 registers and needs 97 cycles
// without and 130 with the glitch rule; this takes 77 and 115 (entry, jump
// and reti included). The stamp is read first: what follows may take its time.
//
// INT0 goes before every other interrupt, so nobody but itself can stop it
// when a noisy input calls it back to back: it counts and masks itself.
//
// r25:r24 is the stamp, r30 and r31 are scratch; r22 and r23 are borrowed only
// by the rule. Always inlined into a naked handler: every operand is constant.
template <typename Ring>
__attribute__((always_inline)) inline void edge_isr(Ring& ring, uint8_t bit,
                                                    uint8_t interrupt,
                                                    uint8_t kept) {
  __asm__ volatile(
      "push r24                     \n\t"
      "in   r24, %[sreg]            \n\t"
      "push r24                     \n\t"
      "push r25                     \n\t"
      "push r30                     \n\t"
      "push r31                     \n\t"
      // now = TCNT1
      "lds  r24, %[tcnt]            \n\t"
      "lds  r25, %[tcnt] + 1        \n\t"
      // if (--budget == 0) mask this interrupt until the next slot, refuse
      "lds  r30, %[budget]          \n\t"
      "dec  r30                     \n\t"
      "sts  %[budget], r30          \n\t"
      "brne 6f                      \n\t"
      "cbi  %[eimsk], %[own]        \n\t"
      "rjmp 5f                      \n\t"
      "6:                           \n\t"
      // now_level = PIND & mask; without the rule (Gate::kOff) accept
      "in   r31, %[pin]             \n\t"
      "andi r31, %[mask]            \n\t"
      "lds  r30, %[gate]            \n\t"
      "tst  r30                     \n\t"
      "breq 3f                      \n\t"
      // the level has gone back: refuse
      "push r23                     \n\t"
      "lds  r23, %[level]           \n\t"
      "cp   r31, r23                \n\t"
      "breq 1f                      \n\t"
      // the newest edge is old (Gate::kOpen): accept
      "cpi  r30, %[open]            \n\t"
      "breq 2f                      \n\t"
      // r22:r30 = now - last; accept if it is at least min_ticks
      "push r22                     \n\t"
      "lds  r22, %[last]            \n\t"
      "lds  r23, %[last] + 1        \n\t"
      "mov  r30, r24                \n\t"
      "sub  r30, r22                \n\t"
      "mov  r22, r25                \n\t"
      "sbc  r22, r23                \n\t"
      "lds  r23, %[min]             \n\t"
      "cp   r30, r23                \n\t"
      "lds  r23, %[min] + 1         \n\t"
      "cpc  r22, r23                \n\t"
      "pop  r22                     \n\t"
      "brcc 2f                      \n\t"
      // refuse: ++rejects
      "1:                           \n\t"
      "pop  r23                     \n\t"
      "5:                           \n\t"
      "lds  r24, %[rejects]         \n\t"
      "lds  r25, %[rejects] + 1     \n\t"
      "adiw r24, 1                  \n\t"
      "sts  %[rejects] + 1, r25     \n\t"
      "sts  %[rejects], r24         \n\t"
      "rjmp 4f                      \n\t"
      // accept under the rule: gate = kClosed, last = now
      "2:                           \n\t"
      "ldi  r30, %[closed]          \n\t"
      "sts  %[gate], r30            \n\t"
      "sts  %[last], r24            \n\t"
      "sts  %[last] + 1, r25        \n\t"
      "pop  r23                     \n\t"
      // accept: level = now_level, stamps[count % kept] = now, ++count
      "3:                           \n\t"
      "sts  %[level], r31           \n\t"
      "lds  r30, %[count]           \n\t"
      "andi r30, %[kept] - 1        \n\t"
      "lsl  r30                     \n\t"
      "ldi  r31, 0                  \n\t"
      "subi r30, lo8(-(%[stamps]))  \n\t"
      "sbci r31, hi8(-(%[stamps]))  \n\t"
      "st   Z, r24                  \n\t"
      "std  Z + 1, r25              \n\t"
      "lds  r24, %[count]           \n\t"
      "lds  r25, %[count] + 1       \n\t"
      "adiw r24, 1                  \n\t"
      "sts  %[count] + 1, r25       \n\t"
      "sts  %[count], r24           \n\t"
      "4:                           \n\t"
      "pop  r31                     \n\t"
      "pop  r30                     \n\t"
      "pop  r25                     \n\t"
      "pop  r24                     \n\t"
      "out  %[sreg], r24            \n\t"
      "pop  r24                     \n\t"
      "reti                         \n\t"
      :
      : [sreg] "I"(_SFR_IO_ADDR(SREG)), [tcnt] "i"(_SFR_MEM_ADDR(TCNT1)),
        [pin] "I"(_SFR_IO_ADDR(PIND)), [mask] "i"(bit),
        [eimsk] "I"(_SFR_IO_ADDR(EIMSK)), [own] "I"(interrupt),
        [budget] "i"(&ring.budget), [gate] "i"(&ring.gate),
        [level] "i"(&ring.level), [last] "i"(&ring.last),
        [min] "i"(&ring.min_ticks), [rejects] "i"(&ring.rejects),
        [count] "i"(&ring.count), [stamps] "i"(&ring.stamps),
        [kept] "i"(kept), [open] "i"(Gate::kOpen),
        [closed] "i"(Gate::kClosed));
}
static_assert((kKeptA & (kKeptA - 1)) == 0 && (kKeptB & (kKeptB - 1)) == 0,
              "the index is count & (kept - 1)");
static_assert(static_cast<uint8_t>(Gate::kOff) == 0, "tst finds it");

}  // namespace

void edges_start(Ring ring, uint16_t min_ticks) {
  Atomic const lock;
  uint8_t const level = PIND;
  budget = edge_budget(min_ticks);
  if (ring == Ring::kA) {
    ring_a.budget = budget;
    first_level_a = level & kRingA;
    ring_a.start(level & kRingA, min_ticks);
    EICRA = static_cast<uint8_t>(EICRA | _BV(ISC00));  // both edges
    EIFR = _BV(INTF0);
    fitted |= _BV(INT0);
  } else {
    ring_b.budget = budget;
    ring_b.start(level & kRingB, min_ticks);
    EICRA = static_cast<uint8_t>(EICRA | _BV(ISC10));
    EIFR = _BV(INTF1);
    fitted |= _BV(INT1);
  }
  EIMSK = fitted;
}

void edges_set_rule(uint16_t min_ticks) {
  uint8_t const next_budget = edge_budget(min_ticks);
  Atomic const lock;
  ring_a.set_rule(min_ticks);
  ring_b.set_rule(min_ticks);
  budget = next_budget;
}

EdgeLatch edges_latch(Ring ring) {
  return ring == Ring::kA ? latch(ring_a) : latch(ring_b);
}

uint16_t edge_stamp_a(uint16_t n) {
  Atomic const lock;
  return ring_a.stamps[n % kKeptA];
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

uint8_t edges_take_masked() {
  Atomic const lock;
  uint8_t const was = masked;
  masked = 0;
  return was;
}

// The flag of a masked interrupt is left as it is: an edge that it tells of
// is judged by the level of the pin, so that the parity of the count holds.
void edges_refresh(bool slot) {
  uint16_t const t = now_low();
  ring_a.refresh(t, budget);
  ring_b.refresh(t, budget);
  if (slot) {
    uint8_t const all = fitted;
    masked = static_cast<uint8_t>(masked | (all & ~EIMSK));
    EIMSK = all;
  }
}

}  // namespace board
}  // namespace dart

ISR(INT0_vect, ISR_NAKED) {
  dart::board::edge_isr(dart::board::ring_a, dart::board::kRingA, INT0,
                        dart::board::kKeptA);
}

ISR(INT1_vect, ISR_NAKED) {
  dart::board::edge_isr(dart::board::ring_b, dart::board::kRingB, INT1,
                        dart::board::kKeptB);
}
