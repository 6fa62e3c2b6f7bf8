// Stands in for avr-libc's where src/app is compiled for this machine.
#ifndef DART_TEST_AVR_IO_H
#define DART_TEST_AVR_IO_H

#include <stdint.h>

extern uint16_t volatile TCNT1;

#endif  // DART_TEST_AVR_IO_H
