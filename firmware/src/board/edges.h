// Encoder interrupts: D2 = ring A, D3 = ring B.
#ifndef DART_BOARD_EDGES_H
#define DART_BOARD_EDGES_H

#include <stdint.h>

#include "../core/encoder.h"

namespace dart {
namespace board {

enum class Ring : uint8_t { kA, kB };

// Starts to count; `min_ticks` is the glitch rule, 0 = off.
void edges_start(Ring ring, uint16_t min_ticks);
// Another rule for both rings; an edge that waits is not lost.
void edges_set_rule(uint16_t min_ticks);

// With interrupts off.
EdgeLatch edges_latch(Ring ring);

// Stamp of edge `n` (modulo 65536) of ring A: one of its last kStampsA.
constexpr uint8_t kStampsA = 8;
uint16_t edge_stamp_a(uint16_t n);

// Edges refused so far, both rings, wraps.
uint16_t edges_rejected();

// Rings (bit 0 A, bit 1 B) that were masked since the last call: their budget
// of edges was used up and the rest of that slot's edges is not counted.
uint8_t edges_take_masked();

// True while ring A's pin level does not fit the parity of its count and no
// edge is on its way.
bool edges_parity_broken();

// From the phase interrupt: a new budget, and in a new slot a new chance.
void edges_refresh(bool slot);

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_EDGES_H
