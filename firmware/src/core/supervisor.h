// Supervises the heartbeat of the host and decides what the outputs of the
// hardware cut-off do. Behaviour is the table in supervisor.cpp.
#ifndef DART_CORE_SUPERVISOR_H
#define DART_CORE_SUPERVISOR_H

#include <stdint.h>

#include "time.h"
#include "wire.h"

namespace dart {

enum class Safety : uint8_t {
  kBoot = 0,
  kIdle = 1,
  kLinked = 2,
  kLive = 3,
  kTripped = 4,
  kLocked = 5,
};
constexpr uint8_t kSafetyStates = 6;

// What a state puts on the option wires.
struct SafetyOutput {
  bool enable;     // L3: gate of the MOSFET that pulls /OE low
  bool pass;       // L4: the ESC gets the PCA9685's pulse, else our own
  bool own_pulse;  // L4: neutral pulse on D9
};

// Inputs of the table, one bit each.
enum Condition : uint8_t {
  kReady = 1u << 0,      // set-up is complete
  kSteady = 1u << 1,     // 500 ms of beats with this boot's token
  kCalm = 1u << 2,       // 500 ms of such beats in mode disarmed
  kArm = 1u << 3,        // last beat: armed or raw, right token
  kDisarm = 1u << 4,     // last beat: disarmed, or a wrong token
  kStop = 1u << 5,       // last beat: stop, whatever its token
  kLost = 1u << 6,       // no beat within the limit
  kThirdTrip = 1u << 7,  // three trips within 60 s
};

struct SafetyTransition {
  Safety from;
  Safety to;
  uint8_t when;    // any of these conditions
  uint8_t unless;  // and none of these
};

// A run of good beats. Whether it is long enough is remembered, because it
// may last for longer than the clock takes to wrap.
struct BeatRun {
  static constexpr Tick kLongEnough = ticks_of_ms(500);

  Tick since;
  bool long_enough;

  void beat(Tick now, bool broken) {
    if (broken) {
      since = now;
      long_enough = false;
    } else if (now - since >= kLongEnough) {
      long_enough = true;
    }
  }
};

class Supervisor {
 public:
  // A run of beats is broken by a longer gap: three periods of 50 Hz.
  static constexpr Tick kMaxGap = ticks_of_ms(60);
  static constexpr Tick kTripWindow = ticks_of_ms(60000);
  static constexpr uint8_t kTripsToLock = 3;
  // beat_age() saturates here [ms].
  static constexpr uint8_t kAgeMax = 255;

  constexpr explicit Supervisor(Tick limit) : limit_(limit) {}

  void set_limit(Tick limit) { limit_ = limit; }
  void set_ready() { ready_ = true; }

  // A valid HEARTBEAT arrived at `now`. A beat with a wrong token keeps the
  // link alive but counts as disarmed.
  void beat(Tick now, wire::BeatMode mode, bool right_token);

  // The outputs were cut without it: as after a lost beat.
  void lose() { heard_ = false; }

  // Takes at most one transition; true when the state has changed. Call it
  // at least every slot.
  bool step(Tick now);

  Safety state() const { return state_; }
  SafetyOutput output() const;
  // A beat came within the limit.
  bool beat_ok(Tick now) const { return !lost(now); }
  uint8_t beat_age_ms(Tick now) const;
  // Conditions that hold (for tests and EVENT frames).
  uint8_t conditions(Tick now) const;

 private:
  bool lost(Tick now) const { return !heard_ || now - beat_ > limit_; }
  void enter(Tick now, Safety next);
  void forget(Tick now);

  Tick limit_;
  Tick beat_ = 0;          // time of the last beat
  BeatRun steady_ = {0, false};  // beats with the right token
  BeatRun calm_ = {0, false};    // of these, disarmed ones
  Tick trips_[kTripsToLock] = {};
  uint8_t trip_count_ = 0;  // trips within the window
  uint8_t command_ = 0;     // kArm, kDisarm or kStop
  Safety state_ = Safety::kBoot;
  bool ready_ = false;
  bool heard_ = false;  // a beat came, less than 1000 s ago
};

}  // namespace dart

#endif  // DART_CORE_SUPERVISOR_H
