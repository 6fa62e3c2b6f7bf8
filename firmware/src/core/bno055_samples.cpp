// BNO055: what is read of a part that runs, slot after slot.
#include <string.h>

#include "bno055.h"
#include "bno055_registers.h"
#include "rom.h"

namespace dart {

using namespace bno055;

namespace {

// Registers looked at besides the samples, one every 25 slots: the mode
// twice a second, the others once.
constexpr uint8_t kStatusSlots = 25;
constexpr uint8_t kStatusTurns[] DART_ROM = {kOprMode, kCalibStat, kOprMode,
                                             kSysStatus};
constexpr uint8_t kModeTurn = 0;

// A sample stays valid past one that was dropped, not past two: the data of
// a part that stands perfectly still are all zeros now and then.
constexpr Tick kHeld = ticks_of_ms(15);

// Where a look leaves its bytes: a read does not need them.
constexpr uint8_t kLookAt = 12;

bool all_zero(uint8_t const* bytes, uint8_t size) {
  while (size != 0 && *bytes == 0) {
    ++bytes;
    --size;
  }
  return size == 0;
}

int16_t word_at(uint8_t const* p) {
  return static_cast<int16_t>(p[0] | static_cast<uint16_t>(p[1] << 8));
}

}  // namespace

void Bno055::look(Tick now) {
  now_ = now;
  looked_ = false;
  bool const well = state_ == ImuState::kRun && valid_ && !zeros_ &&
                    failures_ == 0 && job_ == Job::kNone;
  if (well && plan_ == 0 && busy_time_ <= kLookIfRead && !bus_->lines_low()) {
    begin_read(Job::kLook, kGyroX, leg_ + kLookAt, 6);
  }
}

// Of the gyro's words: in the sample before, as the look saw them, now.
uint8_t Bno055::changed() const {
  uint8_t bits = 0;
  for (uint8_t i = 0; i < 3; ++i) {
    int16_t const seen = word_at(leg_ + kLookAt + 2 * i);
    bits = static_cast<uint8_t>(
        bits | (seen != sample_.gyro[i] ? 1 : 0) |
        (seen != word_at(leg_ + 6 + 2 * i) ? 2 : 0));
  }
  return bits;
}

// Acceleration first, gyro last: the yaw rate is the fresher of the two. The
// reads may straddle an update of the fusion: at most 10 ms of skew.
void Bno055::begin_acc() {
  read_start_ = now_;
  begin_read(Job::kAcc, kLinAccX, leg_, plan_ == 0 ? 6 : 4);
}

// Behind the acceleration, which waits in leg_ for its other half.
void Bno055::begin_gyro() {
  if (plan_ == 0) {
    begin_read(Job::kGyro, kGyroX, leg_ + 6, 6);
    return;
  }
  memset(leg_ + 4, 0, 6);  // z of the acceleration, x and y of the gyro
  begin_read(Job::kGyro, kGyroZ, leg_ + 10, 2);
}

// A part that fell back to CONFIG reads as zeros: they are no sample, and the
// mode is read at once.
void Bno055::take_sample() {
  bool const looked = looked_;
  looked_ = false;
  bool const zeros = all_zero(leg_, 12);
  look_ = zeros && !zeros_;
  zeros_ = zeros;
  if (zeros) {
    valid_ = valid_ && read_start_ - sample_.start < kHeld;
    watch_stuck(true);
    return;
  }
  sample_.changed = looked ? changed() : 0;
  bool equal = true;
  for (uint8_t i = 0; i < 6; ++i) {
    int16_t const word = word_at(leg_ + 2 * i);
    int16_t& axis = i < 3 ? sample_.lin_acc[i] : sample_.gyro[i - 3];
    equal = equal && axis == word;
    axis = word;
  }
  sample_.start = read_start_;
  has_sample_ = valid_ = true;
  busy_time_ = now_ - read_start_;
  watch_stuck(equal);
}

void Bno055::watch_stuck(bool equal) {
  if (!equal) {
    equal_ = 0;
  } else if (equal_ < 255) {
    ++equal_;
  }
  if (equal_ <= 1) {
    edges_equal_ = edges_;
  }
  if (equal_ >= kStuckToReset && stuck()) {
    enter(ImuState::kReset);
  }
}

void Bno055::begin_status() {
  if (state_ != ImuState::kRun) {
    return;
  }
  if (look_) {
    status_turn_ = kModeTurn;
  } else if (++status_slot_ < kStatusSlots) {
    return;
  } else {
    status_slot_ = 0;
    status_turn_ =
        static_cast<uint8_t>((status_turn_ + 1) % sizeof kStatusTurns);
  }
  begin_read(Job::kStatus, rom_byte(&kStatusTurns[status_turn_]), leg_,
             1);
}

void Bno055::take_status() {
  busy_time_ = now_ - read_start_;
  switch (rom_byte(&kStatusTurns[status_turn_])) {
    case kCalibStat:
      calib_ = leg_[0];
      break;
    case kSysStatus:
      if (leg_[0] == kSystemError) {
        enter(ImuState::kReset);
      }
      break;
    default:
      // A brown-out has put the part back into CONFIG: it is fresh from a
      // reset, so the set-up alone brings it back.
      if ((leg_[0] & kModeMask) != kModeImuPlus) {
        ++counters_.reinit;
        enter(ImuState::kSetup);
        run_script();
      }
      break;
  }
}

}  // namespace dart
