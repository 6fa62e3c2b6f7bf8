#include "boot.h"

#include <avr/wdt.h>
#include <stddef.h>

#include "../core/crc16.h"
#include "../core/progress.h"
#include "../core/wire.h"
#include "atomic.h"
#include "clock.h"
#include "outputs.h"
#include "uart.h"

namespace dart {
namespace board {

namespace {

// Kept through resets. Written at every boot and by the watchdog.
struct RunMark {
  uint16_t magic;
  LastRun last_run;
  uint8_t bootloader;
  uint16_t pc;  // word address
  uint16_t crc;
};
constexpr uint16_t kMagic = 0x4D52;

RunMark run_mark __attribute__((section(".noinit")));
uint8_t reset_flags __attribute__((section(".noinit")));

uint16_t crc_of(RunMark const& mark) {
  return crc16(0xFFFF, reinterpret_cast<uint8_t const*>(&mark),
               offsetof(RunMark, crc));
}

void write_mark(LastRun last_run, uint8_t bootloader, uint16_t pc) {
  run_mark = {kMagic, last_run, bootloader, pc, 0};
  run_mark.crc = crc_of(run_mark);
}

bool may_reset_;
Progress progress;
uint8_t watchdog_mode;  // of WDTCSR while the loop is in time

// Slots that the loop may be late before the interrupt is switched on: 40 to
// 50 ms after the last feeding, before the fastest oscillator's 55 ms.
constexpr uint8_t kPatience = 5;
volatile uint8_t patience;  // 0: used up, or not started

// Set while random_bits() listens to the watchdog.
volatile bool harvesting;
volatile uint8_t harvested;

// Change of the watchdog's mode: within four cycles after the key.
void set_watchdog(uint8_t mode) {
  Atomic const lock;
  wdt_reset();
  WDTCSR = _BV(WDCE) | _BV(WDE);
  WDTCSR = mode;
}

constexpr uint8_t k16ms = 0;
constexpr uint8_t k64ms = _BV(WDP1);

}  // namespace

BootReport boot_report() {
  bool const marked =
      run_mark.magic == kMagic && run_mark.crc == crc_of(run_mark);
  BootReport report = {reset_flags, LastRun::kUnknown, Bootloader::kUnknown,
                       0};
  if (marked) {
    report.last_run = run_mark.last_run;
    report.bootloader = static_cast<Bootloader>(run_mark.bootloader);
  }
  if (reset_flags != 0) {
    report.bootloader = Bootloader::kAtmegaBoot;
  } else if (!marked) {
    report.cause = _BV(PORF);
    report.bootloader = Bootloader::kOptiboot;
  } else if (report.last_run == LastRun::kRunning) {
    report.cause = _BV(EXTRF);
    report.bootloader = Bootloader::kOptiboot;
  }
  if (report.last_run == LastRun::kWatchdog) {
    report.cause |= wire::kResetWatchdogMark;
    report.watchdog_pc = static_cast<uint16_t>(run_mark.pc << 1);
  }
  write_mark(LastRun::kRunning, static_cast<uint8_t>(report.bootloader), 0);
  return report;
}

void watchdog_start(bool cutoff, bool may_reset) {
  may_reset_ = may_reset;
  watchdog_mode = static_cast<uint8_t>(
      k64ms | (cutoff || may_reset ? _BV(WDE) : _BV(WDIE)));
  progress.start(slots_begun(), uart_sent());
  set_watchdog(watchdog_mode);
  patience = kPatience;
}

void watchdog_feed() {
  if (!progress.made(slots_begun(), uart_sent())) {
    return;
  }
  Atomic const lock;
  wdt_reset();
  WDTCSR = watchdog_mode;  // WDIE needs no key; the rest is as it was
  patience = kPatience;
}

void watchdog_slot() {
  uint8_t left = patience;
  if (left == 0) {
    return;
  }
  patience = --left;
  if (left == 0) {
    WDTCSR |= _BV(WDIE);
  }
}

// Runs in the watchdog's interrupt and never returns: the loop hangs, so the
// stack it left does not matter.
extern "C" void dart_watchdog_fired(uint16_t pc)
    __attribute__((noreturn, used));
void dart_watchdog_fired(uint16_t pc) {
  outputs_cut();
  write_mark(LastRun::kWatchdog, run_mark.bootloader, pc);
  if (!may_reset_) {
    set_watchdog(0);
  }  // else the interrupt has put it into reset mode: 64 ms from now
  // Interrupts run on: our own pulse stays alive, the line falls silent.
  sei();
  for (;;) {
    __asm__ volatile("" ::: "memory");
  }
}

// Everything that a reset would stop, then the reset vector. The watchdog
// cannot do it: ATmegaBOOT would never let go of it.
static void leave(LastRun why) {
  cli();
  write_mark(why, run_mark.bootloader, 0);
  set_watchdog(0);
  TIMSK1 = TCCR1A = 0;
  EIMSK = 0;
  UCSR0B = 0;
  TWCR = 0;
  PORTB = DDRB = PORTC = DDRC = PORTD = DDRD = 0;
  uint16_t const begin = now_low();
  while ((EECR & _BV(EEPE)) != 0 &&
         static_cast<uint16_t>(now_low() - begin) < ticks_of_ms(5)) {
  }
  TCCR1B = 0;
}

void restart() {
  leave(LastRun::kRestart);
  __asm__ volatile("jmp 0");
  __builtin_unreachable();
}

void restart_bootloader() {
  Bootloader const bootloader =
      static_cast<Bootloader>(run_mark.bootloader);
  leave(LastRun::kRestart);
  if (bootloader == Bootloader::kAtmegaBoot) {
    __asm__ volatile("jmp 0x7800");  // blank flash there runs on to 0
  }
  __asm__ volatile("jmp 0");
  __builtin_unreachable();
}

uint32_t random_bits() {
  uint32_t bits = 0;
  for (uint8_t i = 0; i < 32; ++i) {
    harvesting = true;
    set_watchdog(_BV(WDIE) | k16ms);
    Tick const begin = now();
    while (harvesting && now() - begin < ticks_of_ms(40)) {
    }
    // Rotate and mix: the eight bits of each moment reach all 32.
    bits = (bits << 1) | (bits >> 31);
    bits ^= harvested;
  }
  set_watchdog(0);
  return bits;
}

}  // namespace board
}  // namespace dart

// Before main and before .data: save the cause and stop a watchdog that a
// reset has left on at 16 ms.
extern "C" void dart_init3() __attribute__((naked, used, section(".init3")));
void dart_init3() {
  dart::board::reset_flags = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

// The address of the hang lies on top of the stack, high byte first. While
// random_bits() listens, the interrupt is an ordinary one.
ISR(WDT_vect, ISR_NAKED) {
  __asm__ volatile(
      "push r24                \n\t"
      "in   r24, %[sreg]       \n\t"
      "push r24                \n\t"
      "lds  r24, %[harvesting] \n\t"
      "tst  r24                \n\t"
      "breq 1f                 \n\t"
      "lds  r24, %[tcnt]       \n\t"
      "sts  %[harvested], r24  \n\t"
      "ldi  r24, 0             \n\t"
      "sts  %[harvesting], r24 \n\t"
      "pop  r24                \n\t"
      "out  %[sreg], r24       \n\t"
      "pop  r24                \n\t"
      "reti                    \n\t"
      "1:                      \n\t"
      "pop  r24                \n\t"
      "pop  r24                \n\t"
      "pop  r25                \n\t"
      "pop  r24                \n\t"
      "clr  r1                 \n\t"
      "jmp  dart_watchdog_fired\n\t"
      :
      : [sreg] "I"(_SFR_IO_ADDR(SREG)), [tcnt] "i"(_SFR_MEM_ADDR(TCNT1)),
        [harvesting] "i"(&dart::board::harvesting),
        [harvested] "i"(&dart::board::harvested));
}
