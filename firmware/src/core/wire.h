// The generated messages, their tables kept in flash.
#ifndef DART_CORE_WIRE_H
#define DART_CORE_WIRE_H

#include "rom.h"

#define DART_WIRE_ROM DART_ROM
#include "messages.h"

#endif  // DART_CORE_WIRE_H
