#include "telemetry.h"

#include "../board/capture.h"
#include "../board/clock.h"
#include "../board/edges.h"
#include "../board/stack.h"
#include "../board/supply.h"
#include "../board/uart.h"
#include "inputs.h"
#include "link.h"
#include "logbook.h"
#include "state.h"
#include "state_frame.h"
#include "version.h"

namespace dart {
namespace app {

namespace {

using namespace wire;

constexpr uint8_t kDiagSlots = 50;  // 2 Hz

// HELLO comes unasked at boot: three times, 100 ms apart.
constexpr uint8_t kBootHellos = 3;
constexpr uint8_t kHelloSlots = 10;
uint8_t boot_hellos = kBootHellos;
uint8_t hello_in = 0;
bool hello_asked;
uint8_t hello_seq;

uint8_t diag_in = kDiagSlots;

// Answers that wait; the oldest first.
constexpr uint8_t kAnswers = 2;
ParamAnswer answers[kAnswers];
uint8_t answers_waiting;

bool pong_waiting;
TimePing ping;
Tick ping_received;

bool capture_asked;
Tick capture_deadline;

uint16_t overruns;
uint16_t cycle_max_us;

// From here to the first byte of a PONG in the transmitter: its CRC and
// COBS take 1600 cycles = 200 ticks, and interrupts may come between.
constexpr Tick kPongBuild = 320;
static_assert(kPongBuild <= board::kMaxStartWait, "the wait is bounded");

uint8_t cap(bool has, Cap bit) {
  return static_cast<uint8_t>(has ? static_cast<uint8_t>(bit) : 0);
}

uint16_t caps() {
  return static_cast<uint16_t>(
      cap(true, Cap::kCapture) | cap(true, Cap::kGyroLook) |
      cap(settings.ring_b, Cap::kRingB) |
      cap(settings.safety_out == 1, Cap::kOutputEnable) |
      cap(settings.safety_out == 2, Cap::kMultiplexer) |
      cap(settings.wdt_reset, Cap::kWatchdogReset));
}

void send_hello(uint8_t req_seq) {
  Hello h;
  h.proto = kProto;
  h.req_seq = req_seq;
  h.schema = kSchema;
  h.fw_version[0] = kVersionMajor;
  h.fw_version[1] = kVersionMinor;
  h.fw_version[2] = kVersionPatch;
  h.build = kBuildFlags;
  h.git = kSourceHash;
  h.board_id = identity.board_id();
  h.boot_count = identity.boot_count();
  h.reset_cause = boot.cause;
  h.bootloader = static_cast<uint8_t>(boot.bootloader);
  h.boot_nonce = identity.nonce();
  h.edges_per_rev[0] =
      static_cast<uint8_t>(params.get(ParamId::kEdgesPerRevA));
  h.edges_per_rev[1] =
      static_cast<uint8_t>(params.get(ParamId::kEdgesPerRevB));
  h.caps = caps();
  h.clock_hz = kTicksPerSecond;
  h.param_crc = params.crc();
  send(h);
}

void send_diag(Tick now) {
  ImuCounters const& c = imu.counters();
  board::UartErrors const uart = board::uart_errors();
  Diag d;
  d.t_ck = now;
  d.rx_ok = rx_stats.ok;
  d.rx_crc = rx_stats.crc;
  d.rx_len = rx_stats.length;
  d.rx_seq_gap = rx_stats.seq_gap;
  d.uart_fe = uart.framing;
  d.uart_overrun = uart.overrun;
  d.i2c_nack = c.nack;
  d.i2c_timeout = c.timeout;
  d.i2c_recover = c.recover;
  d.imu_reinit = c.reinit;
  d.edges_rejected = board::edges_rejected();
  d.loop_max_us = cycle_max_us;
  d.loop_overruns = overruns;
  d.stack_free = board::stack_free();
  d.vcc_mv = board::supply_mv();
  d.boot_count = identity.boot_count();
  cycle_max_us = 0;
  send(d);
}

void send_answer() {
  ParamAnswer const& a = answers[0];
  ParamValue v;
  v.id = a.id;
  v.status = static_cast<uint8_t>(a.status);
  v.req_seq = a.req_seq;
  v.value = params.get(static_cast<ParamId>(a.id));
  send(v);
  --answers_waiting;
  for (uint8_t i = 0; i < answers_waiting; ++i) {
    answers[i] = answers[i + 1];
  }
}

bool capture_done(Tick now) {
  return capture_asked &&
         (!board::capture_running() || reached(now, capture_deadline));
}

bool hello_due() {
  if (boot_hellos == 0 || hello_in != 0) {
    return hello_asked;
  }
  --boot_hellos;
  hello_in = kHelloSlots;
  return true;
}

}  // namespace

void send_next(Tick now) {
  if (hello_in != 0) {
    --hello_in;
  }
  if (diag_in != 0) {
    --diag_in;
  }
  if (rc_due()) {
    send(rc_frame(now));
  } else if (hello_due()) {
    send_hello(hello_seq);
    hello_asked = false;
    hello_seq = 0;
  } else if (answers_waiting != 0) {
    send_answer();
  } else if (!events.empty()) {
    send(events.take());
  } else if (capture_done(now)) {
    capture_asked = false;
    send(board::capture_take());
  } else if (diag_in == 0) {
    diag_in = kDiagSlots;
    send_diag(now);
  } else if (battery_ready()) {
    send(battery_frame());
  } else if (edge_log.ready()) {
    send(edge_log.frame());
    edge_log.sent();
  } else {
    send_log();
  }
}

void send_pong() {
  if (!pong_waiting || !board::uart_idle()) {
    return;
  }
  pong_waiting = false;
  TimePong p;
  p.ping_id = ping.ping_id;
  p.host_us = ping.host_us;
  p.rx_ck = ping_received;
  p.tx_ck = board::now() + kPongBuild;
  p.reserved = 0;
  send_at(p, p.tx_ck);
}

void ask_hello(uint8_t req_seq) {
  hello_asked = true;
  hello_seq = req_seq;
}

void ask_diag() { diag_in = 0; }

void ask_capture(uint16_t periods, Tick now) {
  // 250 periods of 20 ms are 5 s; a slow or silent channel ends by time.
  uint16_t const n = periods < 250 ? periods : 250;
  capture_asked = n != 0;
  capture_deadline = now + ticks_of_ms(100 + 25ul * n);
  board::capture_begin(n);
}

bool ask_param_value(ParamAnswer const& answer) {
  if (answers_waiting == kAnswers) {
    return false;
  }
  answers[answers_waiting++] = answer;
  return true;
}

void ask_pong(TimePing const& request, Tick received) {
  ping = request;
  ping_received = received;
  pong_waiting = true;
}

void note_overrun(Tick now, uint8_t missed) {
  flag_overrun();
  overruns = static_cast<uint16_t>(overruns + (missed != 0 ? missed : 1));
  events.push(now, EventCode::kLoopOverrun, missed);
}

void note_cycle(Tick length) {
  uint32_t const us = length / kTicksPerUs;
  if (us > cycle_max_us) {
    cycle_max_us = us < 0xFFFF ? static_cast<uint16_t>(us) : 0xFFFF;
  }
}

}  // namespace app
}  // namespace dart
