// BNO055: start-up, sampling and recovery as one machine that never waits.
//
//   Probe -> Setup -> Run <-> Save          PowerOff -> Probe
//     ^        |       |                       ^  ^        |
//     |        v       v     not acknowledged  |  |  3 x without a Run
//   AfterReset <- ResetWait <- Reset ----------+  +-- Backoff (5 s)
//
// Recovery ladder: a failed leg is repeated in the next slot; two in a row
// or a low line restart the TWI, then clock the bus free; ten in a row (or a
// wrong identity, or SYS_STATUS 1) reset the part; a reset that is refused
// or does not help switches its supply.
#ifndef DART_CORE_BNO055_H
#define DART_CORE_BNO055_H

#include <stdint.h>

#include "bus.h"
#include "slots.h"
#include "time.h"

namespace dart {

enum class ImuState : uint8_t {
  kProbe = 0,       // powered: waits for CHIP_ID
  kSetup = 1,       // registers and offsets are written and read back
  kRun = 2,         // one sample per slot
  kSave = 3,        // offsets are read, in CONFIG mode
  kReset = 4,       // soft reset is sent
  kResetWait = 5,   // the part boots
  kAfterReset = 6,  // waits for CHIP_ID
  kPowerOff = 7,
  kBackoff = 8,  // absent: tries again now and then
};
constexpr uint8_t kImuStates = 9;

// Raw words in sensor axes: 0.01 m/s^2 and 1/900 rad/s. Plan 1 leaves the
// axes that it does not read at 0.
struct ImuSample {
  Tick start;  // of the first of its two reads
  int16_t lin_acc[3];
  int16_t gyro[3];
  // Where the gyro's data changed since the read before: bit 0 before the
  // look, bit 1 after it. The part's clock is not ours: that tells its phase.
  uint8_t changed;
};

struct ImuCounters {  // since boot, they wrap
  uint16_t nack;
  uint16_t timeout;  // also arbitration and stuck lines
  uint8_t recover;
  uint8_t reinit;
};

class Bno055 {
 public:
  // Deadline of a leg of samples.
  static constexpr Tick kLegLimit = ticks_of_ms(6);
  // Deadline of a leg of a script, while there are no samples. The longest,
  // 22 offsets at 180 us of stretching per byte, takes 25 x (22.5 + 180) us =
  // 5.1 ms at 400 kHz, and 25 x (90 + 180) us = 6.8 ms at 100 kHz.
  static constexpr Tick kScriptLegLimit = ticks_of_ms(8);
  // A look is over before the read of its slot, which begins 3 ms later: it
  // takes half as long as a read, none is made of a part whose reads take
  // more than 5 ms, and one that hangs is ended.
  static constexpr Tick kLookIfRead = ticks_of_ms(5);
  static constexpr Tick kLookLimit = kLookIfRead / 2;
  static constexpr uint8_t kFailuresToReset = 10;
  static constexpr uint8_t kPowerTries = 3;
  // 20 equal samples (200 ms) while the wheel turns: 19 repetitions.
  static constexpr uint8_t kStuckSamples = 19;
  static constexpr uint8_t kStuckToReset = 250;
  static constexpr uint8_t kMaxLeg = kOffsetsSize;

  // The part got its supply at `now`. Bus and store must outlive this; plan:
  // parameter imu_plan. Before any other call.
  void start(Bus& bus, SlotStore& offsets, Tick now, uint8_t plan);
  void set_plan(uint8_t plan) { plan_ = plan; }

  // Any time, often: finishes legs, watches deadlines.
  void step(Tick now);

  // Once per slot, when a read may begin. `edges` is ring A's count;
  // `quiet` says that the car stands and may do without data for 60 ms.
  void slot(Tick now, uint32_t edges, bool quiet);

  // Once per slot, 3 ms before slot(): reads the gyro, if all is well, to see
  // whether its data have changed yet.
  void look(Tick now);

  ImuState state() const { return state_; }
  // The last read was good, its data are not stuck.
  bool valid() const { return valid_ && !stuck(); }
  bool stuck() const;
  bool absent() const { return power_tries_ >= kPowerTries; }
  // A sample exists and is younger than 262 ms; else its age is unknown.
  bool has_sample() const { return has_sample_; }
  ImuSample const& sample() const { return sample_; }
  uint8_t calib() const { return calib_; }
  ImuCounters const& counters() const { return counters_; }
  BusStatus last_error() const { return last_error_; }
  // The offsets in force are the factory's, not our own.
  bool factory_offsets() const { return refused_ || !offsets_->loaded(); }
  // No leg is under way: the loop has nothing to wait for.
  bool resting() const { return job_ == Job::kNone; }
  // How long the reads of the last complete slot took.
  Tick busy_time() const { return busy_time_; }

 private:
  enum class Job : uint8_t { kNone, kProbe, kScript, kLook, kAcc, kGyro,
                             kStatus, kReset };

  void enter(ImuState next);
  void begin_read(Job job, uint8_t reg, uint8_t* to, uint8_t size);
  void begin_write(Job job, uint8_t reg, uint8_t size);
  Tick leg_limit() const;
  bool lines_free();
  void finish(BusStatus status);
  void fail(BusStatus kind);
  void count_error(BusStatus kind);
  void run_script();
  void script_done();
  bool check_step();
  void keep_offsets();
  void begin_acc();
  void begin_gyro();
  uint8_t changed() const;
  void take_sample();
  void begin_status();
  void take_status();
  void watch_stuck(bool equal);
  bool save_due() const;

  // Pointers, so that the object is all zeros at first and costs no flash.
  Bus* bus_ = nullptr;
  SlotStore* offsets_ = nullptr;
  ImuSample sample_ = {};
  ImuCounters counters_ = {};
  uint8_t leg_[kMaxLeg] = {};  // bytes of the leg under way
  Tick now_ = 0;  // of the call under way
  Tick leg_start_ = 0;
  Tick read_start_ = 0;  // of the sample under way
  Tick entered_ = 0;  // into the state
  Tick resume_ = 0;   // of the script
  Tick busy_time_ = 0;
  uint32_t edges_ = 0;        // newest count
  uint32_t edges_equal_ = 0;  // count when the equal samples began
  ImuState state_ = ImuState::kProbe;
  Job job_ = Job::kNone;
  BusStatus last_error_ = BusStatus::kBusy;  // none yet
  uint8_t plan_ = 0;
  uint8_t address_ = 0;
  uint8_t script_at_ = 0;
  uint8_t failures_ = 0;     // legs in a row
  uint8_t resets_ = 0;       // since the last Run
  uint8_t power_tries_ = 0;  // since the last Run
  uint8_t equal_ = 0;        // samples in a row
  uint8_t status_slot_ = 0;  // counts slots up to the next status read
  uint8_t status_turn_ = 0;
  uint8_t calib_ = 0;
  bool waiting_ = false;  // the script waits for resume_
  bool valid_ = false;
  bool zeros_ = false;  // what was read last
  bool look_ = false;   // at the mode, now
  bool looked_ = false;  // at the gyro, in this slot
  bool has_sample_ = false;
  bool quiet_ = false;
  bool refused_ = false;  // the part did not take our offsets
  bool saved_ = false;    // offsets were looked at in this boot
};

}  // namespace dart

#endif  // DART_CORE_BNO055_H
