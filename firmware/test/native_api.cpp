// C interface of src/core for ctypes. One object of each kind at a time is
// enough: every test begins with a *_new call.
#include <string.h>

#include <new>

#include "../src/core/baud_guard.h"
#include "../src/core/battery_meter.h"
#include "../src/core/beat_counter.h"
#include "../src/core/bno055.h"
#include "../src/core/crc16.h"
#include "../src/core/direction.h"
#include "../src/core/edge_counter.h"
#include "../src/core/edge_log.h"
#include "../src/core/encoder.h"
#include "../src/core/events.h"
#include "../src/core/frame.h"
#include "../src/core/identity.h"
#include "../src/core/params.h"
#include "../src/core/progress.h"
#include "../src/core/pulse_capture.h"
#include "../src/core/rc_receiver.h"
#include "../src/core/rx_stats.h"
#include "../src/core/stamp_ring.h"
#include "../src/core/supervisor.h"

using namespace dart;

#define API extern "C" __attribute__((visibility("default")))

namespace {

// Unpacks with the generated code, packs again: proves both.
template <class M>
bool repack(uint8_t id, uint8_t const* in, uint8_t* out) {
  if (id != M::kId) {
    return false;
  }
  M message;
  memset(static_cast<void*>(&message), 0xA5, sizeof message);
  unpack(in, M::kSize, message);
  pack(message, out);
  return true;
}

template <class M>
bool seed_of(uint8_t id, uint16_t& seed) {
  if (id != M::kId) {
    return false;
  }
  seed = M::kSeed;
  return true;
}

template <class... M>
struct Messages {};
using Fixed =
    Messages<wire::Hello, wire::HelloReq, wire::State, wire::Diag,
             wire::TimePong, wire::Event, wire::Edges, wire::ParamValue,
             wire::Capture, wire::Rc, wire::Battery, wire::Heartbeat,
             wire::TimePing, wire::ParamGet,
             wire::ParamSet, wire::Reboot, wire::EdgesReq, wire::CaptureReq>;

bool repack_any(Messages<>, uint8_t, uint8_t const*, uint8_t*) {
  return false;
}
template <class M, class... Rest>
bool repack_any(Messages<M, Rest...>, uint8_t id, uint8_t const* in,
                uint8_t* out) {
  return repack<M>(id, in, out) ||
         repack_any(Messages<Rest...>{}, id, in, out);
}
bool seed_any(Messages<>, uint8_t, uint16_t&) { return false; }
template <class M, class... Rest>
bool seed_any(Messages<M, Rest...>, uint8_t id, uint16_t& seed) {
  return seed_of<M>(id, seed) || seed_any(Messages<Rest...>{}, id, seed);
}

FrameParser parser;
RxStats stats;
Encoder encoder;
EdgeCounter<8> counter;
EdgeLog edge_log;
EventQueue events;
PulseCapture capture;
BaudGuard baud_guard;
DirectionGuard direction;
BeatCounter beats;
Progress progress;
RcReceiver receiver;
StampRing stamps;
BatteryMeter meter;
Supervisor supervisor(0);

// EEPROM in memory that can lose its supply after some writes.
class FakeEeprom : public Eeprom {
 public:
  uint8_t cells[1024];
  int32_t writes_left = -1;  // < 0: no limit
  int32_t busy_polls = 0;    // polls until a write is done
  int32_t busy_for = 0;
  uint32_t illegal = 0;  // accesses during a write

  uint8_t read(uint16_t address) override {
    illegal += busy_polls > 0;
    return cells[address];
  }
  bool busy() override {
    if (busy_polls > 0) {
      --busy_polls;
      return true;
    }
    return false;
  }
  void write(uint16_t address, uint8_t value) override {
    illegal += busy_polls > 0;
    busy_polls = busy_for;
    if (writes_left == 0) {
      return;
    }
    if (writes_left > 0) {
      --writes_left;
    }
    cells[address] = value;
  }
};
FakeEeprom eeprom;
Params params(eeprom);
Identity identity(eeprom);
uint8_t offset_bytes[kOffsetsSize];
SlotStore offsets(eeprom, kOffsetsPlace, offset_bytes);

// A bus whose every answer comes from the test.
struct BusCalls {
  int32_t (*start)(int32_t reading, int32_t address, int32_t reg,
                   uint8_t* data, int32_t size);
  int32_t (*poll)();
  void (*abort)();
  int32_t (*lines_low)();
  void (*restart)();
  void (*clear)();
  void (*power)(int32_t on);
};

class TestBus : public Bus {
 public:
  BusCalls calls;

  void start_write(uint8_t address, uint8_t reg, uint8_t const* data,
                   uint8_t size) override {
    calls.start(0, address, reg, const_cast<uint8_t*>(data), size);
  }
  void start_read(uint8_t address, uint8_t reg, uint8_t* data,
                  uint8_t size) override {
    calls.start(1, address, reg, data, size);
  }
  BusStatus poll() override { return static_cast<BusStatus>(calls.poll()); }
  void abort() override { calls.abort(); }
  bool lines_low() override { return calls.lines_low() != 0; }
  void restart() override { calls.restart(); }
  void clear() override { calls.clear(); }
  void power(bool on) override { calls.power(on); }
};
TestBus bus;
Bno055 imu;

template <class T, class... Args>
void renew(T& object, Args&&... args) {
  object.~T();
  memset(static_cast<void*>(&object), 0xA5, sizeof object);
  new (static_cast<void*>(&object)) T(static_cast<Args&&>(args)...);
}

}  // namespace

// --- frames ---------------------------------------------------------------

API uint16_t core_crc16(uint16_t seed, uint8_t const* data, uint32_t size) {
  return crc16(seed, data, size);
}

// Frame of a payload, through unpack and pack; 0 = no such message. LOG is
// framed as it is, any other message must have its exact size.
API int32_t core_frame(uint8_t id, uint8_t seq, uint8_t const* payload,
                       uint8_t size, uint8_t* out) {
  uint8_t raw[wire::kMaxRaw] = {id, seq};
  uint16_t seed = wire::Log::kSeed;
  if (id == wire::Log::kId) {
    memcpy(raw + 2, payload, size);
  } else if (!repack_any(Fixed{}, id, payload, raw + 2) ||
             !seed_any(Fixed{}, id, seed)) {
    return 0;
  }
  return build_frame(raw, static_cast<uint8_t>(size + 2), seed, out);
}

API void parser_new() {
  renew(parser);
  stats = RxStats{};
}

// Feeds a stream. Each accepted frame appends type, seq and payload size to
// `found`, then the payload. Returns bytes written; |counts| ok, crc,
// length, seq_gap.
API int32_t parser_feed(uint8_t const* data, int32_t size, uint8_t* found,
                        int32_t room, uint16_t* counts) {
  int32_t used = 0;
  for (int32_t i = 0; i < size; ++i) {
    Frame frame;
    if (!receive(parser, data[i], stats, frame)) {
      continue;
    }
    uint8_t const n =
        static_cast<uint8_t>(parser.size() - wire::kRawOverhead);
    if (used + 3 + n > room) {
      return -1;
    }
    found[used++] = frame.type;
    found[used++] = frame.seq;
    found[used++] = n;
    memcpy(found + used, frame.payload, n);
    used += n;
  }
  counts[0] = stats.ok;
  counts[1] = stats.crc;
  counts[2] = stats.length;
  counts[3] = stats.seq_gap;
  return used;
}

// --- encoder --------------------------------------------------------------

API void encoder_new(uint32_t now) {
  renew(encoder);
  encoder.update(now, {0, 0, 0});
}

API void encoder_update(uint32_t now, uint16_t count, uint16_t last,
                        uint16_t previous, uint32_t* out) {
  encoder.update(now, {count, last, previous});
  out[0] = encoder.count();
  out[1] = encoder.last();
  out[2] = encoder.interval();
}

API void counter_new(uint8_t level, uint16_t min_ticks) {
  memset(&counter, 0, sizeof counter);
  counter.start(level, min_ticks);
  counter.budget = edge_budget(min_ticks);
}
API int32_t counter_edge(uint16_t now, uint8_t level) {
  return counter.edge(now, level);
}
API void counter_refresh(uint16_t now) {
  counter.refresh(now, edge_budget(counter.min_ticks));
}
API void counter_rule(uint16_t min_ticks) { counter.set_rule(min_ticks); }
API void counter_get(uint16_t* out) {
  out[0] = counter.count;
  out[1] = counter.rejects;
  for (uint8_t i = 0; i < 8; ++i) {
    out[2 + i] = counter.stamps[i];
  }
}

API void edge_log_new() { renew(edge_log); }
API void edge_log_request(uint16_t frames) { edge_log.request(frames); }
API void edge_log_gap() { edge_log.gap(); }
API int32_t edge_log_add(uint32_t count, uint32_t time) {
  edge_log.add(count, time);
  return edge_log.ready();
}
API void edge_log_take(uint8_t* out) {
  pack(edge_log.frame(), out);
  edge_log.sent();
}
API int32_t edge_log_active() { return edge_log.active(); }

API void direction_new() { renew(direction); }
API void direction_command(uint8_t d) {
  direction.command(static_cast<wire::Direction>(d));
}
API int32_t direction_update(uint32_t count) {
  direction.update(count);
  return direction.ambiguous() | direction.standing() << 1;
}

// --- small ones -----------------------------------------------------------

API void events_new() { renew(events); }
API void events_push(uint32_t now, uint8_t code, uint32_t arg) {
  events.push(now, static_cast<wire::EventCode>(code), arg);
}
API int32_t events_take(uint8_t* out) {
  if (events.empty()) {
    return 0;
  }
  pack(events.take(), out);
  return 1;
}

API void capture_begin(uint16_t periods) { capture.begin(periods); }
API int32_t capture_edge(uint32_t now, int32_t rising, uint8_t* out) {
  if (rising != 0) {
    capture.rise(now);
  } else {
    capture.fall(now);
  }
  pack(capture.result, out);
  return capture.running;
}

API void baud_new() { renew(baud_guard); }
API int32_t baud_slot(int32_t bytes, int32_t valid, uint8_t framing) {
  for (int32_t i = 0; i < bytes; ++i) {
    baud_guard.byte();
  }
  if (valid != 0) {
    baud_guard.valid_frame();
  }
  return baud_guard.slot(framing);
}

API void beats_new() { renew(beats); }
API int32_t beats_beat(uint16_t limit_ms) {
  return beats.beat(BeatCounter::slots(limit_ms));
}
API int32_t beats_slot() { return beats.slot(); }

API void progress_new(uint8_t slots, uint8_t sent) {
  renew(progress);
  progress.start(slots, sent);
}
API int32_t progress_made(uint8_t slots, uint8_t sent) {
  return progress.made(slots, sent);
}

// --- RC receiver, battery -------------------------------------------------

API void rc_new(uint32_t now, uint8_t levels) {
  renew(receiver);
  receiver.start(now, levels);
}
API void rc_edge(uint32_t at, uint8_t levels) { receiver.edge(at, levels); }
API void rc_gap(uint32_t now, uint8_t levels) { receiver.gap(now, levels); }
API void rc_frame(uint32_t now, uint8_t* out) {
  pack(receiver.frame(now), out);
}

API void stamps_new(uint8_t count) {
  renew(stamps);
  stamps.written = stamps.taken = count;
}
API int32_t stamps_put(uint16_t at, uint8_t levels) {
  return stamps.put(at, levels);
}
// The stamp in bits 8 to 23 and the levels in bits 0 to 7; -1: empty.
API int32_t stamps_take() {
  PinStamp stamp;
  return stamps.take(stamp) ? stamp.at << 8 | stamp.levels : -1;
}

API void meter_new() {
  renew(meter);
  meter.start();
}
API int32_t meter_next(uint32_t now, uint16_t counts) {
  return static_cast<int32_t>(meter.next(now, counts));
}
// 1: a result was written.
API int32_t meter_take(uint8_t* out) {
  if (!meter.ready()) {
    return 0;
  }
  pack(meter.take(), out);
  return 1;
}

// --- supervisor -----------------------------------------------------------

API void supervisor_new(uint32_t limit) { renew(supervisor, limit); }
API void supervisor_ready() { supervisor.set_ready(); }
API void supervisor_beat(uint32_t now, uint8_t mode, int32_t token) {
  supervisor.beat(now, static_cast<wire::BeatMode>(mode), token != 0);
}
API void supervisor_lose() { supervisor.lose(); }
API int32_t supervisor_step(uint32_t now) { return supervisor.step(now); }
// |out| state, enable, pass, own_pulse, beat_ok, beat_age, conditions
API void supervisor_get(uint32_t now, uint8_t* out) {
  SafetyOutput const o = supervisor.output();
  out[0] = static_cast<uint8_t>(supervisor.state());
  out[1] = o.enable;
  out[2] = o.pass;
  out[3] = o.own_pulse;
  out[4] = supervisor.beat_ok(now);
  out[5] = supervisor.beat_age_ms(now);
  out[6] = supervisor.conditions(now);
}

// --- EEPROM ---------------------------------------------------------------

API uint8_t* eeprom_cells() { return eeprom.cells; }
API void eeprom_set(int32_t writes_left, int32_t busy_for) {
  eeprom.writes_left = writes_left;
  eeprom.busy_polls = 0;
  eeprom.busy_for = busy_for;
  eeprom.illegal = 0;
}
API uint32_t eeprom_illegal() { return eeprom.illegal; }

API int32_t params_load() {
  renew(params, eeprom);
  return params.load();
}
API uint32_t params_get(uint16_t id) {
  return params.get(static_cast<wire::ParamId>(id));
}
API int32_t params_set(uint16_t id, uint32_t value) {
  return static_cast<int32_t>(params.set(id, value));
}
// 1: a value was stored.
API int32_t params_step() { return params.step(); }
API uint16_t params_crc() { return params.crc(); }

API int32_t identity_load() {
  renew(identity, eeprom);
  return identity.load();
}
API void identity_make(uint32_t id) { identity.make(id); }
API void identity_boot() { identity.count_boot(); }
API int32_t identity_step() {
  identity.store().step();
  return identity.store().saving();
}
API void identity_get(uint32_t* out) {
  out[0] = identity.board_id();
  out[1] = identity.boot_count();
  out[2] = identity.nonce();
}

// --- BNO055 ---------------------------------------------------------------

API void imu_new(BusCalls const* calls, uint32_t now, uint8_t plan) {
  bus.calls = *calls;
  renew(offsets, eeprom, kOffsetsPlace,
        static_cast<uint8_t*>(offset_bytes));
  offsets.load();
  renew(imu);
  imu.start(bus, offsets, now, plan);
}
API void imu_step(uint32_t now) { imu.step(now); }
API void imu_slot(uint32_t now, uint32_t edges, int32_t quiet) {
  imu.slot(now, edges, quiet != 0);
}
API void imu_look(uint32_t now) { imu.look(now); }
API int32_t imu_store_step() {
  offsets.step();
  return offsets.saving();
}
// |out| state, valid, stuck, absent, has_sample, calib, factory, resting,
// nack, timeout, recover, reinit, start, lin_acc[3], gyro[3], changed
API void imu_get(int64_t* out) {
  ImuCounters const& c = imu.counters();
  ImuSample const& s = imu.sample();
  int64_t const values[] = {
      static_cast<int64_t>(imu.state()), imu.valid(), imu.stuck(),
      imu.absent(), imu.has_sample(), imu.calib(), imu.factory_offsets(),
      imu.resting(), c.nack, c.timeout, c.recover, c.reinit, s.start,
      s.lin_acc[0], s.lin_acc[1], s.lin_acc[2], s.gyro[0], s.gyro[1],
      s.gyro[2], s.changed};
  memcpy(out, values, sizeof values);
}
