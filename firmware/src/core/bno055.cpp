#include "bno055.h"

#include "bno055_registers.h"
#include "rom.h"

namespace dart {

using namespace bno055;

namespace {

// How long a state may last and what comes then; 0 = no limit.
struct StateRow {
  ImuState state;
  uint16_t limit_ms;
  ImuState then;
};

// The part needs 400 ms after power, drivers allow for 850; 650 ms after a
// reset. Setup takes 25 + 20 ms and 12 legs.
constexpr StateRow kStates[] DART_ROM = {
    {ImuState::kProbe, 1100, ImuState::kPowerOff},
    {ImuState::kSetup, 1000, ImuState::kReset},
    {ImuState::kRun, 0, ImuState::kRun},
    {ImuState::kSave, 500, ImuState::kReset},
    {ImuState::kReset, 50, ImuState::kPowerOff},
    {ImuState::kResetWait, 650, ImuState::kAfterReset},
    {ImuState::kAfterReset, 250, ImuState::kPowerOff},
    {ImuState::kPowerOff, 100, ImuState::kProbe},
    {ImuState::kBackoff, 5000, ImuState::kPowerOff},
};

// Recursive, as gnu++11 wants it: the Arduino IDE compiles with that.
constexpr bool states_in_order(uint8_t i = 0) {
  return i == kImuStates || (static_cast<uint8_t>(kStates[i].state) == i &&
                             states_in_order(static_cast<uint8_t>(i + 1)));
}
static_assert(sizeof kStates / sizeof kStates[0] == kImuStates,
              "every state has a row");
static_assert(states_in_order(), "the state is the index");

bool has_script(ImuState state) {
  return state == ImuState::kSetup || state == ImuState::kSave;
}

// imu_age ends here (65535 x 4 us).
constexpr Tick kMaxAge = ticks_of_ms(262);

}  // namespace

void Bno055::start(Bus& bus, SlotStore& offsets, Tick now, uint8_t plan) {
  bus_ = &bus;
  offsets_ = &offsets;
  now_ = now;
  plan_ = plan;
  address_ = kAddress;
  enter(ImuState::kProbe);
}

bool Bno055::stuck() const {
  return equal_ >= kStuckSamples && edges_ - edges_equal_ >= 2;
}

// --- states ---------------------------------------------------------------

void Bno055::enter(ImuState next) {
  if (next == ImuState::kPowerOff && state_ != ImuState::kBackoff) {
    if (power_tries_ < kPowerTries) {
      ++power_tries_;
    }
    if (absent()) {
      next = ImuState::kBackoff;
    }
  }
  if (next == ImuState::kReset && ++resets_ > 1) {
    enter(ImuState::kPowerOff);  // the reset did not help
    return;
  }
  if (next == ImuState::kPowerOff || next == ImuState::kReset) {
    ++counters_.reinit;
  }
  if (next == ImuState::kPowerOff || state_ == ImuState::kPowerOff) {
    bus_->power(next != ImuState::kPowerOff);
    resets_ = 0;
  }
  if (next == ImuState::kSetup) {
    calib_ = 0;
  }
  if (next == ImuState::kRun) {
    resets_ = power_tries_ = 0;
    equal_ = 0;
  }
  valid_ = false;
  failures_ = 0;
  script_at_ = 0;
  waiting_ = false;
  entered_ = now_;
  state_ = next;
}

void Bno055::step(Tick now) {
  now_ = now;
  if (job_ != Job::kNone) {
    BusStatus status = bus_->poll();
    if (status == BusStatus::kBusy) {
      if (now - leg_start_ < leg_limit()) {
        return;
      }
      bus_->abort();
      status = BusStatus::kTimeout;
    }
    finish(status);
    return;
  }
  StateRow const row = rom_read(kStates[static_cast<uint8_t>(state_)]);
  if (row.limit_ms != 0 && now - entered_ >= ticks_of_ms(row.limit_ms)) {
    enter(row.then);
    return;
  }
  if (has_script(state_) && failures_ == 0) {
    run_script();
  }
}

void Bno055::slot(Tick now, uint32_t edges, bool quiet) {
  now_ = now;
  edges_ = edges;
  quiet_ = quiet;
  if (has_sample_ && now - sample_.start > kMaxAge) {
    has_sample_ = false;
  }
  if (job_ != Job::kNone || state_ == ImuState::kPowerOff ||
      state_ == ImuState::kBackoff || state_ == ImuState::kResetWait) {
    return;
  }
  if (!lines_free()) {
    return;
  }
  switch (state_) {
    case ImuState::kProbe:
    case ImuState::kAfterReset:
      begin_read(Job::kProbe, kChipId, leg_, 1);
      break;
    case ImuState::kReset:
      leg_[0] = kTriggerReset;
      begin_write(Job::kReset, kSysTrigger, 1);
      break;
    case ImuState::kRun:
      if (save_due()) {
        saved_ = true;
        enter(ImuState::kSave);
        run_script();
      } else {
        begin_acc();
      }
      break;
    default:
      run_script();
      break;
  }
}

bool Bno055::save_due() const {
  return quiet_ && !saved_ && fully_calibrated(calib_);
}

// --- legs -----------------------------------------------------------------

void Bno055::begin_read(Job job, uint8_t reg, uint8_t* to,
                        uint8_t size) {
  job_ = job;
  leg_start_ = now_;
  bus_->start_read(address_, reg, to, size);
}

Tick Bno055::leg_limit() const {
  return job_ == Job::kLook     ? kLookLimit
         : job_ == Job::kScript ? kScriptLegLimit
                                : kLegLimit;
}

void Bno055::begin_write(Job job, uint8_t reg, uint8_t size) {
  job_ = job;
  leg_start_ = now_;
  bus_->start_write(address_, reg, leg_, size);
}

// Looks before it talks: a held line costs no deadline.
bool Bno055::lines_free() {
  if (!bus_->lines_low()) {
    return true;
  }
  fail(BusStatus::kStuck);
  return false;
}

void Bno055::count_error(BusStatus kind) {
  bool const nack =
      kind == BusStatus::kAddressNack || kind == BusStatus::kDataNack;
  // A part that boots does not answer: that is no fault.
  bool const booting =
      state_ == ImuState::kProbe || state_ == ImuState::kAfterReset;
  if (nack && booting) {
    return;
  }
  last_error_ = kind;
  if (nack) {
    ++counters_.nack;
  } else {
    ++counters_.timeout;
  }
}

void Bno055::fail(BusStatus kind) {
  count_error(kind);
  valid_ = false;
  script_at_ = 0;
  waiting_ = false;
  if (failures_ < 255) {
    ++failures_;
  }
  if (failures_ == 2 || bus_->lines_low()) {
    bus_->restart();
    if (bus_->lines_low()) {
      bus_->clear();
    }
    if (state_ != ImuState::kProbe && state_ != ImuState::kAfterReset) {
      ++counters_.recover;
    }
  }
  if (state_ == ImuState::kReset) {
    enter(ImuState::kPowerOff);
  } else if (failures_ >= kFailuresToReset &&
             (state_ == ImuState::kRun || has_script(state_))) {
    enter(ImuState::kReset);
  }
}

void Bno055::finish(BusStatus status) {
  Job const job = job_;
  job_ = Job::kNone;
  if (job == Job::kLook) {
    looked_ = status == BusStatus::kDone;  // if not, the read will find out
    return;
  }
  if (status != BusStatus::kDone) {
    if (job == Job::kProbe) {
      address_ ^= kAddress ^ kAddressAlt;
    }
    fail(status);
    return;
  }
  failures_ = 0;
  switch (job) {
    case Job::kProbe:
      if (leg_[0] == kChipIdValue) {
        enter(ImuState::kSetup);
        run_script();
      }
      break;
    case Job::kReset:
      enter(ImuState::kResetWait);
      break;
    case Job::kScript:
      script_done();
      break;
    case Job::kAcc:
      begin_gyro();
      break;
    case Job::kGyro:
      take_sample();
      begin_status();
      break;
    case Job::kStatus:
      take_status();
      break;
    case Job::kLook:
    case Job::kNone:
      break;
  }
}

}  // namespace dart
