// Why the board booted, and the ways to boot it again.
#ifndef DART_BOARD_BOOT_H
#define DART_BOARD_BOOT_H

#include <stdint.h>

namespace dart {
namespace board {

// What RAM tells about the run before this boot; it survives every reset but
// a power cut.
enum class LastRun : uint8_t {
  kUnknown = 0,   // no valid mark: power-on
  kRunning = 1,   // it ran until something reset it
  kWatchdog = 2,  // its watchdog fired
  kRestart = 3,   // it restarted itself on request
};

enum class Bootloader : uint8_t {
  kUnknown = 0,
  kAtmegaBoot = 1,  // leaves MCUSR as it is; or there is none
  kOptiboot = 2,    // clears MCUSR
};

struct BootReport {
  uint8_t cause;  // MCUSR bits, + 0x10 = the watchdog fired before
  LastRun last_run;
  Bootloader bootloader;
  uint16_t watchdog_pc;  // byte address, with LastRun::kWatchdog
};

// Reads what the start-up code has saved and marks this run as running.
BootReport boot_report();

// Watchdog in interrupt mode. WDTO_60MS: 8192 cycles of a 128 kHz
// oscillator are 64 ms (55 to 75 on real parts), six slots. WDTO_120MS
// would come after up to 149 ms: too late for the 120 ms of a lost beat.
//
// |may_reset| after the interrupt the hardware resets; only for Optiboot:
// ATmegaBOOT leaves the watchdog on and would reset for ever.
void watchdog_start(bool may_reset);

// Feeds the watchdog if the slot interrupt and the transmitter have both
// made progress since the last call. From the loop, once per slot.
void watchdog_feed();

// Outputs go to their reset state and the program starts again.
void restart() __attribute__((noreturn));
void restart_bootloader() __attribute__((noreturn));

// 32 random bits: how the watchdog's oscillator runs against the crystal,
// folded from 32 of its interrupts. Takes 0.5 s; before watchdog_start().
uint32_t random_bits();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_BOOT_H
