#include <Arduino.h>
#include "app/link.h"
#include "board/atomic.h"
#include "board/clock.h"
#include "board/edges.h"
#include "board/pins.h"
#include "board/sleep.h"
#include "board/uart.h"
#include "board/interrupts.h"
#include "core/encoder.h"
#include "core/crc16.h"
using namespace dart;
namespace dart { namespace board { void on_phase() { edges_refresh(); } } }
static Encoder enc; static uint8_t slot; 
void setup() {
  TIMSK0 = 0; TCCR0B = 0;
  board::pins_start(); board::clock_start(); board::uart_start(board::Baud::k500000);
  board::edges_start(board::Ring::kA, 200);
}
static void hello() {
  wire::Hello h = {}; h.proto = wire::kProto; h.schema = wire::kSchema; h.fw_version[1]=1; h.board_id=0xDA27DA27; h.boot_count=1; h.reset_cause=2;
  uint8_t b[6]={0x27,0xDA,0x27,0xDA,1,0}; h.boot_nonce=crc16(0xFFFF,b,6);
  h.edges_per_rev[0]=20; h.edges_per_rev[1]=10; h.clock_hz=wire::kTicksPerSecond; app::send(h);
}
void loop() {
  board::PhaseEvent e = board::take_phases();
  board::RxByte b; while (board::uart_read(b)) {}
  if (e.slot) {
    wire::State s = {};
    { board::Atomic lock; Tick t = board::now_locked(); EdgeLatch l = board::edges_latch(board::Ring::kA); s.t_ck = t; enc.update(t, l); }
    s.enc_count = enc.count(); s.enc_t_ck = enc.last(); s.enc_dt_ck = enc.interval();
    s.imu_age = 65535; s.beat_age = 255; s.flags = wire::kImuStale | wire::kImuAbsent;
    app::send(s);
    if (slot < 30 && slot % 10 == 0) hello();
    if (slot < 255) ++slot;
  }
  board::sleep_until_interrupt();
}
