// libFuzzer: whole commands through src/app's own dispatch, with a board that
// only keeps time. The input is a list of events (a good frame of any command
// and payload, raw bytes, time that passes). Laws: the ESC gets the
// PCA9685's pulse in LIVE alone; a link needs 500 ms of this boot's token, after
// a trip in mode disarmed; LIVE needs a beat that says so, within the limit;
// no parameter leaves its range.
#include <setjmp.h>
#include <string.h>

#include <new>

#include "../src/app/commands.h"
#include "../src/app/inputs.h"
#include "../src/app/safety.h"
#include "../src/app/state.h"
#include "../src/app/telemetry.h"
#include "../src/board/clock.h"
#include "../src/board/edges.h"
#include "../src/board/outputs.h"
#include "../src/board/uart.h"
#include "fuzz.h"

uint16_t volatile TCNT1;

namespace {

constexpr uint16_t kEeprom = 0x100;  // what firmware/src/core/slots.h uses of it

struct Board {
  dart::Tick now;
  uint8_t line[dart::kMaxWire];
  uint8_t line_size;
  uint8_t line_next;
  uint8_t eeprom[kEeprom];
  dart::SafetyOutput outputs;
  jmp_buf left;  // the way out of a function that never returns
};
Board board_;

}  // namespace

namespace dart {
namespace board {

Tick now() { return board_.now; }
bool uart_read(RxByte& byte) {
  if (board_.line_next == board_.line_size) {
    return false;
  }
  byte = {board_.line[board_.line_next++],
          static_cast<uint16_t>(board_.now)};
  return true;
}
UartErrors uart_errors() { return {0, 0}; }
void restart() { longjmp(board_.left, 1); }
void restart_bootloader() { longjmp(board_.left, 1); }
void outputs_start(Cutoff) { board_.outputs = {false, false, true}; }
void outputs_set(SafetyOutput const& output) { board_.outputs = output; }
bool beats_refresh(uint16_t) { return false; }
void led(bool) {}
void edges_set_rule(uint16_t) {}
uint8_t AvrEeprom::read(uint16_t address) {
  LAW(address < kEeprom);
  return board_.eeprom[address];
}
bool AvrEeprom::busy() { return false; }
void AvrEeprom::write(uint16_t address, uint8_t value) {
  LAW(address < kEeprom);
  board_.eeprom[address] = value;
}
void Twi::set_clock(uint16_t khz) { LAW(khz >= 100 && khz <= 400); }
void Twi::start_write(uint8_t, uint8_t, uint8_t const*, uint8_t) {}
void Twi::start_read(uint8_t, uint8_t, uint8_t*, uint8_t) {}
BusStatus Twi::poll() { return BusStatus::kDone; }
void Twi::abort() {}
bool Twi::lines_low() { return false; }
void Twi::restart() {}
void Twi::clear() {}
void Twi::power(bool) {}

}  // namespace board

namespace app {

void ask_hello(uint8_t) {}
void ask_diag() {}
void ask_capture(uint16_t, Tick) {}
bool ask_param_value(ParamAnswer const&) { return true; }
void ask_pong(wire::TimePing const&, Tick) {}
void request_inputs(Tick, uint8_t) {}

}  // namespace app
}  // namespace dart

using namespace dart;

namespace {

template <class T, class... Args>
void renew(T& object, Args&&... args) {
  object.~T();
  new (static_cast<void*>(&object)) T(static_cast<Args&&>(args)...);
}

void boot(Input& input) {
  memset(board_.eeprom, 0xFF, kEeprom);
  renew(app::params, app::eeprom);
  renew(app::identity, app::eeprom);
  renew(app::supervisor, 0u);
  renew(app::direction);
  renew(app::edge_log);
  renew(app::events);
  app::rx_stats = RxStats{};
  // Any time of the clock's wrap; the line is clean after a boot.
  board_.now = static_cast<Tick>(input.word()) << 16;
  board_.line[0] = 0;
  board_.line_size = 1;
  board_.line_next = 0;
  app::receive_frames();
  app::params.load();
  app::identity.make(0x0DA27001);
  app::identity.count_boot();
  app::settings = {false, false, static_cast<uint8_t>(input.byte() % 3)};
  app::apply_params();
  app::safety_start(board_.now);
}

// What the harness itself knows of the beats.
struct Beats {
  Tick newest;
  Tick run;   // the beat since which every further one was good
  Tick calm;  // and the one since which they were disarmed, too
  bool heard;
  bool may_live;

  void beat(Tick now, wire::Heartbeat const& beat) {
    if (beat.mode > static_cast<uint8_t>(wire::BeatMode::kStop)) {
      return;
    }
    auto const mode = static_cast<wire::BeatMode>(beat.mode);
    bool const good = beat.arm_token == app::identity.nonce() &&
                      mode != wire::BeatMode::kStop;
    bool const broken = !good || !heard || now - newest > ticks_of_ms(60);
    if (broken) {
      run = now;
    }
    if (broken || mode != wire::BeatMode::kDisarmed) {
      calm = now;
    }
    heard = true;
    newest = now;
    may_live = good && mode != wire::BeatMode::kDisarmed;
  }
};
Beats beats;

void check() {
  bool const live = app::supervisor.state() == Safety::kLive;
  LAW(!board_.outputs.pass || live);
  LAW(!(board_.outputs.pass && !board_.outputs.enable));
  if (live) {
    Tick const limit =
        ticks_of_ms(app::params.get(wire::ParamId::kBeatTimeoutMs));
    LAW(beats.may_live && board_.now - beats.newest <= limit);
  }
}

void check_params() {
  for (wire::ParamSpec const& spec : wire::kParams) {
    uint32_t const value = app::params.get(static_cast<wire::ParamId>(spec.id));
    LAW(value >= spec.low && value <= spec.high);
  }
}

// The way from one state to the next, whatever lay between.
void check_way(Safety before, Tick calm) {
  Safety const after = app::supervisor.state();
  bool const linked = after == Safety::kLinked || after == Safety::kLive;
  if (before == Safety::kIdle && linked) {
    LAW(board_.now - beats.run >= ticks_of_ms(500));
  }
  if (before == Safety::kTripped && linked) {
    LAW(board_.now - calm >= ticks_of_ms(500));
  }
  LAW(before != Safety::kLocked || after == Safety::kLocked);
}

void pass_time(Tick ticks) {
  board_.now += ticks;
  Safety const before = app::supervisor.state();
  app::safety_step(board_.now);
  LAW(before == Safety::kLive || app::supervisor.state() != Safety::kLive);
  check_way(before, beats.calm);
  if (app::params.step()) {
    app::param_stored(board_.now);
  }
  check();
}

void send(uint8_t const* bytes, uint8_t size) {
  memcpy(board_.line, bytes, size);
  board_.line_size = size;
  board_.line_next = 0;
  app::receive_frames();
  app::safety_step(board_.now);  // as the loop does
  LAW(board_.line_next == board_.line_size);
}

void command(Input& input, uint8_t which) {
  wire::FrameSpec const& spec = wire::kDown[which];
  uint8_t raw[wire::kMaxRaw] = {spec.id, input.byte()};
  for (uint8_t i = 0; i < spec.size; ++i) {
    raw[2 + i] = input.byte();
  }
  bool const is_beat = spec.id == wire::Heartbeat::kId;
  Safety const before = app::supervisor.state();
  Tick const calm = beats.calm;
  wire::Heartbeat beat = {};
  if (is_beat) {
    unpack(raw + 2, beat);
    if ((raw[1] & 3) != 0) {  // three of four carry what a host would send
      beat.arm_token = app::identity.nonce();
      beat.mode = static_cast<decltype(beat.mode)>(beat.mode & 3);
    }
    pack(beat, raw + 2);
  }
  uint16_t const accepted = app::rx_stats.ok;
  uint8_t out[kMaxWire];
  send(out, build_frame(raw, static_cast<uint8_t>(spec.size + 2), spec.seed,
                        out));
  if (is_beat && app::rx_stats.ok != accepted) {  // not glued to garbage
    beats.beat(board_.now, beat);
  }
  LAW(is_beat || before == Safety::kLive ||
      app::supervisor.state() != Safety::kLive);
  check_way(before, calm);
  check();
  if (spec.id == wire::ParamSet::kId) {
    check_params();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(uint8_t const* data, size_t size) {
  Input input = {data, size};
  beats = Beats{};
  if (setjmp(board_.left) != 0) {
    return 0;
  }
  boot(input);
  while (!input.empty()) {
    uint8_t const choice = input.byte();
    if (choice < wire::kDownCount) {
      command(input, choice);
    } else if (choice < 0x20) {  // a good host beats for a while
      uint8_t const mode = input.byte();
      for (uint8_t i = choice / 2; i != 0; --i) {
        pass_time(ticks_of_ms(50));
        uint8_t good[] = {0, 1, 0, 0, 0, 0, mode, 0, 0, 0, 0, 0, 0, 0};
        wire::Heartbeat beat = {};
        beat.mode = static_cast<decltype(beat.mode)>(mode & 3);
        pack(beat, good + 2);
        Input one = {good + 1, sizeof good - 1};
        command(one, 1);
      }
    } else if (choice < 0x40) {
      uint8_t const bytes[] = {input.byte(), input.byte(), input.byte()};
      send(bytes, sizeof bytes);
      check();
    } else {
      pass_time(ticks_of_ms(static_cast<uint32_t>(choice - 0x40)));
    }
  }
  return 0;
}
