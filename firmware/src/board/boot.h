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

// Watchdog. WDTO_60MS: 8192 cycles of a 128 kHz oscillator are 64 ms (55 to
// 75 on real parts), six slots. WDTO_120MS would come after up to 149 ms: too
// late for the 120 ms of a lost beat.
//
// A loop that hangs: the interrupt makes the outputs safe and keeps the
// address; then the program stands still (own pulse alive), or, with
// |may_reset|, the hardware resets.
//
// A hang with interrupts off never runs that interrupt, so with a |cutoff|
// the watchdog is in reset mode and the slot interrupt switches its
// interrupt on when the loop is late: no slot interrupt, no mercy. Optiboot
// then starts the program again. ATmegaBOOT leaves the watchdog on, so the
// board resets every 16 ms until its supply is cut, its pins inputs all the
// while: /OE high, or no pulse through the multiplexer. A car that stands
// until somebody replugs it is the better end; without a cut-off there is no
// pin to let go of, and the host sees the silence.
void watchdog_start(bool cutoff, bool may_reset);

// Feeds the watchdog if the slot interrupt and the transmitter have both
// made progress since the last call. From the loop, once per slot.
void watchdog_feed();

// From the slot interrupt.
void watchdog_slot();

// Outputs go to their reset state and the program starts again, once the
// EEPROM has finished its byte (3.4 ms).
void restart() __attribute__((noreturn));
void restart_bootloader() __attribute__((noreturn));

// 32 random bits: how the watchdog's oscillator runs against the crystal,
// folded from 32 of its interrupts. Takes 0.5 s; before watchdog_start().
uint32_t random_bits();

}  // namespace board
}  // namespace dart

#endif  // DART_BOARD_BOOT_H
