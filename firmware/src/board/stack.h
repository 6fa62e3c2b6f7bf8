// How much RAM the stack has never touched.
#ifndef DART_BOARD_STACK_H
#define DART_BOARD_STACK_H

#include <stdint.h>

namespace dart {
namespace board {

// RAM above the variables is painted before main; a call looks at the next
// piece of it. Every 20 calls or so the figure is complete.
void stack_scan();

// Bytes never touched, as of the last complete scan; 0 before the first.
uint16_t stack_free();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_STACK_H
