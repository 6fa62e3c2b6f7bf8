// What the three fuzz harnesses share: the input as a stream of choices, and
// an abort that names the law it saw broken.
#ifndef DART_TEST_FUZZ_H
#define DART_TEST_FUZZ_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define LAW(holds)                                                   \
  do {                                                               \
    if (!(holds)) {                                                  \
      fprintf(stderr, "%s:%d: law broken: %s\n", __FILE__, __LINE__, \
              #holds);                                               \
      abort();                                                       \
    }                                                                \
  } while (false)

struct Input {
  uint8_t const* next;
  size_t left;

  bool empty() const { return left == 0; }

  uint8_t byte() {
    if (left == 0) {
      return 0;
    }
    --left;
    return *next++;
  }

  uint16_t word() {
    uint8_t const low = byte();
    return static_cast<uint16_t>(low | byte() << 8);
  }
};

#endif  // DART_TEST_FUZZ_H
