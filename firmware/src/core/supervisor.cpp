#include "supervisor.h"

namespace dart {

namespace {

// The first row that fits wins. A stop or a lost beat blocks every way up.
constexpr SafetyTransition kTable[] DART_ROM = {
    {Safety::kBoot, Safety::kIdle, kReady, 0},
    {Safety::kIdle, Safety::kLinked, kSteady, kStop | kLost},
    {Safety::kLinked, Safety::kIdle, kStop | kLost, 0},
    {Safety::kLinked, Safety::kLive, kArm, kStop | kLost},
    {Safety::kLive, Safety::kTripped, kStop | kLost, 0},
    {Safety::kLive, Safety::kLinked, kDisarm, 0},
    {Safety::kTripped, Safety::kLocked, kThirdTrip, 0},
    {Safety::kTripped, Safety::kLinked, kCalm, kStop | kLost},
};
constexpr uint8_t kRows = sizeof kTable / sizeof kTable[0];

struct OutputRow {
  Safety state;
  SafetyOutput output;
};

// LINKED enables /OE because the ESC must see neutral before it arms.
constexpr OutputRow kOutputs[] DART_ROM = {
    {Safety::kBoot, {false, false, false}},
    {Safety::kIdle, {false, false, true}},
    {Safety::kLinked, {true, false, true}},
    {Safety::kLive, {true, true, true}},
    {Safety::kTripped, {false, false, true}},
    {Safety::kLocked, {false, false, true}},
};

constexpr bool outputs_in_order(uint8_t i = 0) {
  return i == kSafetyStates ||
         (static_cast<uint8_t>(kOutputs[i].state) == i &&
          outputs_in_order(static_cast<uint8_t>(i + 1)));
}
static_assert(sizeof kOutputs / sizeof kOutputs[0] == kSafetyStates,
              "every state has an output");
static_assert(outputs_in_order(), "the state is the index");

constexpr uint8_t ways_out(Safety state, uint8_t i = 0) {
  return i == kRows ? uint8_t{0}
                    : static_cast<uint8_t>(
                          (kTable[i].from == state ? 1 : 0) +
                          ways_out(state, static_cast<uint8_t>(i + 1)));
}
static_assert(ways_out(Safety::kBoot) == 1 && ways_out(Safety::kIdle) == 1 &&
                  ways_out(Safety::kLinked) == 2 &&
                  ways_out(Safety::kLive) == 2 &&
                  ways_out(Safety::kTripped) == 2 &&
                  ways_out(Safety::kLocked) == 0,
              "LOCKED is left by reset only, every other state by the table");

constexpr bool live_only_from_linked(uint8_t i = 0) {
  return i == kRows || ((kTable[i].to != Safety::kLive ||
                         kTable[i].from == Safety::kLinked) &&
                        live_only_from_linked(static_cast<uint8_t>(i + 1)));
}
static_assert(live_only_from_linked(), "nothing arms without a steady link");

uint8_t command_of(wire::BeatMode mode, bool right_token) {
  if (mode == wire::BeatMode::kStop) {
    return kStop;
  }
  bool const arm =
      mode == wire::BeatMode::kArmed || mode == wire::BeatMode::kRaw;
  return arm && right_token ? kArm : kDisarm;
}

}  // namespace

void Supervisor::beat(Tick now, wire::BeatMode mode, bool right_token) {
  if (state_ == Safety::kLive && lost(now)) {
    enter(now, Safety::kTripped);  // a late beat must not hide the gap
  }
  bool const fresh_run = !heard_ || now - beat_ > kMaxGap;
  command_ = command_of(mode, right_token);
  bool const broken = fresh_run || !right_token;
  steady_.beat(now, broken || command_ == kStop);
  calm_.beat(now, broken || command_ != kDisarm);
  beat_ = now;
  heard_ = true;
}

uint8_t Supervisor::conditions(Tick now) const {
  uint8_t set = ready_ ? kReady : 0;
  if (lost(now)) {
    set |= kLost;
  } else {
    set = static_cast<uint8_t>(set | command_);
  }
  if (heard_ && now - beat_ <= kMaxGap) {
    set = static_cast<uint8_t>(set | (steady_.long_enough ? kSteady : 0) |
                               (calm_.long_enough ? kCalm : 0));
  }
  if (trip_count_ == kTripsToLock) {
    set |= kThirdTrip;
  }
  return set;
}

// Times that are about to wrap become facts.
void Supervisor::forget(Tick now) {
  if (heard_ && now - beat_ > ticks_of_ms(1000000)) {
    heard_ = false;
  }
  // A beat is stamped when it arrived, which may be before the look that
  // tripped: such a trip lies ahead, not 2147 s back.
  if (trip_count_ != 0 && reached(now, trips_[0] + kTripWindow + 1)) {
    for (uint8_t i = 1; i < trip_count_; ++i) {
      trips_[i - 1] = trips_[i];
    }
    --trip_count_;
  }
}

void Supervisor::enter(Tick now, Safety next) {
  state_ = next;
  if (next == Safety::kTripped && trip_count_ < kTripsToLock) {
    trips_[trip_count_++] = now;
    calm_.beat(now, true);
  }
}

bool Supervisor::step(Tick now) {
  forget(now);
  uint8_t const set = conditions(now);
  for (uint8_t i = 0; i < kRows; ++i) {
    SafetyTransition const row = rom_read(kTable[i]);
    if (row.from == state_ && (row.when & set) != 0 &&
        (row.unless & set) == 0) {
      enter(now, row.to);
      return true;
    }
  }
  return false;
}

SafetyOutput Supervisor::output() const {
  return rom_read(kOutputs[static_cast<uint8_t>(state_)]).output;
}

uint8_t Supervisor::beat_age_ms(Tick now) const {
  Tick const age = now - beat_;
  if (!heard_ || age >= ticks_of_ms(kAgeMax)) {
    return kAgeMax;
  }
  // Age / 2000 without a 32-bit division: age < 2^19, and 2000 = 125 x 16.
  uint16_t const sixteenths = static_cast<uint16_t>(age >> 4);
  return static_cast<uint8_t>(sixteenths / 125u);
}

}  // namespace dart
