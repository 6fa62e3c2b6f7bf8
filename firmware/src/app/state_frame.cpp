#include "state_frame.h"

#include "../board/uart.h"
#include "link.h"
#include "sensors.h"
#include "state.h"

namespace dart {
namespace app {

namespace {

using namespace wire;

constexpr Tick kStale = ticks_of_ms(20);

bool overrun;
uint16_t rx_errors_seen;
board::UartErrors uart_seen;

// Bits of State::flags, gathered.
struct Flags {
  uint16_t bits;

  void add(bool on, Flag flag) {
    if (on) {
      bits = static_cast<uint16_t>(bits | flag);
    }
  }
};

uint16_t age_in_4us(Tick age) {
  // 4 us are 8 ticks; the sample is known to be younger than 262 ms.
  uint32_t const units = age >> 3;
  return units < 0xFFFF ? static_cast<uint16_t>(units) : 0xFFFF;
}

void add_imu(Flags& flags, Tick now) {
  bool const fresh = imu.has_sample() && now - imu.sample().start <= kStale;
  flags.add(imu.valid() && fresh, kImuValid);
  flags.add(!fresh, kImuStale);
  flags.add(imu.stuck(), kImuStuck);
  flags.add(imu.absent(), kImuAbsent);
}

bool take_rx_error() {
  board::UartErrors const uart = board::uart_errors();
  uint16_t const errors = rx_stats.errors();
  bool const any = errors != rx_errors_seen ||
                   uart.framing != uart_seen.framing ||
                   uart.overrun != uart_seen.overrun;
  rx_errors_seen = errors;
  uart_seen = uart;
  return any;
}

void add_errors(Flags& flags) {
  flags.add(take_reject(), kEncReject);
  flags.add(overrun, kSlotOverrun);
  flags.add(take_dropped(), kTxDropped);
  flags.add(take_rx_error(), kRxError);
  overrun = false;
}

void add_conditions(Flags& flags, Tick now) {
  Safety const safety = supervisor.state();
  flags.add(direction.ambiguous(), kEncAmbiguous);
  flags.add(settings.ring_b, kEnc2Present);
  flags.add(supervisor.beat_ok(now), kBeatOk);
  flags.add(safety == Safety::kLive, kOutputLive);
  flags.add(safety == Safety::kTripped || safety == Safety::kLocked,
            kTripped);
  flags.add(param_defaults, kParamDefaults);
  flags.add(boot.last_run == board::LastRun::kWatchdog, kWatchdogLastBoot);
}

}  // namespace

void send_state() {
  Tick const now = latch_encoders();
  ImuSample const& sample = imu.sample();
  State s;
  s.t_ck = now;
  s.enc_count = ring_a.count();
  s.enc_t_ck = ring_a.last();
  s.enc_dt_ck = ring_a.interval();
  s.enc2_count = static_cast<uint16_t>(ring_b.count());
  s.enc2_t_ck = ring_b.last();
  for (uint8_t i = 0; i < 3; ++i) {
    s.lin_acc[i] = sample.lin_acc[i];
    s.gyro[i] = sample.gyro[i];
  }
  s.imu_age = imu.has_sample() ? age_in_4us(now - sample.start) : 0xFFFF;
  // No magnetometer runs: its two bits of CALIB_STAT tell of the looks.
  s.calib = static_cast<uint8_t>((imu.calib() & 0xFC) | sample.changed);
  Flags flags = {0};
  add_imu(flags, now);
  add_errors(flags);
  add_conditions(flags, now);
  s.flags = flags.bits;
  s.beat_age = supervisor.beat_age_ms(now);
  send(s);
}

void flag_overrun() { overrun = true; }

}  // namespace app
}  // namespace dart
