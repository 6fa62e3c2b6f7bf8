// DART-HAL firmware of the Arduino Nano: encoder and IMU up, heartbeat down.
//
// Interrupts stamp edges, move bytes and cut slots of 10 ms; the loop does
// the rest and sleeps in between. It never waits for anything.
#include <Arduino.h>  // setup, loop: the core's main calls them

#include "app/commands.h"
#include "app/inputs.h"
#include "app/logbook.h"
#include "app/safety.h"
#include "app/sensors.h"
#include "app/state.h"
#include "app/state_frame.h"
#include "app/telemetry.h"
#include "board/boot.h"
#include "board/clock.h"
#include "board/edges.h"
#include "board/interrupts.h"
#include "board/outputs.h"
#include "board/pins.h"
#include "board/sleep.h"
#include "board/stack.h"
#include "board/supply.h"
#include "board/uart.h"

using namespace dart;
using namespace dart::app;

namespace {

board::Baud baud;

void start_core_off() {
  // The core's init() has started Timer0 for millis() and Timer2 for PWM:
  // nobody asks for them. Timer2 would also cost simavr an event every 64
  // cycles, asleep or not: a third of the speed of the emulation.
  TIMSK0 = 0;
  TCCR0B = 0;
  TCCR2B = 0;
}

void load_eeprom() {
  param_defaults = !params.load();
  offsets.load();
  if (!identity.load()) {
    identity.make(board::random_bits());
    log_line(LogLine::kNewBoard);
  }
  identity.count_boot();
  settings = {params.get(wire::ParamId::kRingB) != 0,
              params.get(wire::ParamId::kWdtReset) != 0 &&
                  boot.bootloader == board::Bootloader::kOptiboot,
              static_cast<uint8_t>(params.get(wire::ParamId::kSafetyOut))};
}

void start_encoders() {
  uint16_t const min_ticks = static_cast<uint16_t>(
      params.get(wire::ParamId::kEdgeMinUs) * kTicksPerUs);
  board::edges_start(board::Ring::kA, min_ticks);
  if (settings.ring_b) {
    board::edges_start(board::Ring::kB, min_ticks);
  }
}

void start_line() {
  bool const fast = params.get(wire::ParamId::kBaud) == 500000;
  baud = fast ? board::Baud::k500000 : board::Baud::k115200;
  board::uart_start(baud);
}

void toggle_baud() {
  baud = baud == board::Baud::k500000 ? board::Baud::k115200
                                      : board::Baud::k500000;
  board::uart_start(baud);
  log_line(LogLine::kBaudChanged);
}

void report_boot(Tick now) {
  events.push(now, wire::EventCode::kBoot, boot.cause);
  if (boot.last_run == board::LastRun::kWatchdog) {
    events.push(now, wire::EventCode::kWatchdog, boot.watchdog_pc);
    log_line(LogLine::kWatchdog);
  }
  if (param_defaults) {
    log_line(LogLine::kParamDefaults);
  }
  if (imu.factory_offsets()) {
    log_line(LogLine::kFactoryOffsets);
  }
}

void write_eeprom() {
  identity.store().step();
  if (params.step()) {  // looks before the offsets take the next byte's turn
    param_stored(board::now());
  }
  offsets.step();
}

// The whole of a slot but the IMU.
void run_slot(uint8_t late) {
  Tick const begin = board::now();
  send_state();
  inputs_slot(begin);
  send_next(begin);
  if (late != 0) {
    note_overrun(begin, late);
  }
  watch_encoder(begin);
  board::stack_scan();
  board::watchdog_feed();
  if (baud_is_wrong()) {
    toggle_baud();
  }
  note_cycle(board::now() - begin + imu.busy_time());
}

}  // namespace

void setup() {
  start_core_off();
  boot = board::boot_report();
  board::pins_start();
  board::clock_start();
  load_eeprom();
  start_line();
  start_encoders();
  board::supply_start();
  apply_params();
  Tick const now = board::now();
  imu.start(twi, offsets, now,
            static_cast<uint8_t>(params.get(wire::ParamId::kImuPlan)));
  report_boot(now);
  safety_start(now);
  board::take_phases();  // slots of the set-up are not late, they never were
  board::watchdog_start(settings.safety_out != 0, settings.wdt_reset);
}

void loop() {
  board::PhaseEvent const phase = board::take_phases();
  if (phase.slot) {
    run_slot(phase.late);
  }
  receive_frames();
  Tick const now = latch_encoders();
  collect_edges();
  collect_pulses();
  safety_step(now);
  send_pong();
  imu_step(now);
  if (phase.imu) {
    imu_slot(board::now());
  } else if (phase.slot) {
    imu_look(board::now());
  }
  write_eeprom();
  board::sleep_until_interrupt();
}

void board::on_phase(bool slot) {
  edges_refresh(slot);
  if (slot) {
    beats_slot();
    watchdog_slot();
  }
}
