// Set-up and saving of the offsets: registers one after the other.
#include <string.h>

#include "bno055.h"
#include "bno055_registers.h"
#include "rom.h"

namespace dart {

using namespace bno055;

namespace {

// Scripts: legs and waits that are done one after the other.
enum class Op : uint8_t {
  kWrite,        // value into reg, then wait
  kExpect,       // reg must read value
  kRestore,      // write the stored offsets, if there are any
  kCompare,      // they must read back
  kReadOffsets,  // for the store
  kEnd,
};

struct ScriptStep {
  Op op;
  uint8_t reg;
  uint8_t value;
  uint8_t wait_ms;
};

// Units before the mode: they are lost at every reset of the part. To CONFIG
// takes 19 ms, from it 7 ms.
constexpr ScriptStep kSetupScript[] DART_ROM = {
    {Op::kExpect, kChipId, kChipIdValue, 0},
    {Op::kWrite, kPageId, 0, 0},
    {Op::kWrite, kOprMode, kModeConfig, 25},
    {Op::kWrite, kPwrMode, 0, 0},
    {Op::kWrite, kSysTrigger, 0, 0},
    {Op::kWrite, kUnitSel, kUnits, 0},
    {Op::kRestore, kOffsets, 0, 0},
    {Op::kCompare, kOffsets, 0, 0},
    {Op::kWrite, kOprMode, kModeImuPlus, 20},
    {Op::kExpect, kUnitSel, kUnits, 0},
    {Op::kExpect, kOprMode, kModeImuPlus, 0},
    {Op::kEnd, 0, 0, 0},
};

constexpr ScriptStep kSaveScript[] DART_ROM = {
    {Op::kWrite, kOprMode, kModeConfig, 25},
    {Op::kReadOffsets, kOffsets, 0, 0},
    {Op::kWrite, kOprMode, kModeImuPlus, 20},
    {Op::kExpect, kOprMode, kModeImuPlus, 0},
    {Op::kEnd, 0, 0, 0},
};

ScriptStep step_of(ImuState state, uint8_t at) {
  return rom_read(state == ImuState::kSave ? kSaveScript[at]
                                           : kSetupScript[at]);
}

}  // namespace

void Bno055::run_script() {
  if (waiting_ && !reached(now_, resume_)) {
    return;
  }
  waiting_ = false;
  ScriptStep step = step_of(state_, script_at_);
  while ((step.op == Op::kRestore || step.op == Op::kCompare) &&
         factory_offsets()) {
    step = step_of(state_, ++script_at_);
  }
  switch (step.op) {
    case Op::kWrite:
      leg_[0] = step.value;
      begin_write(Job::kScript, step.reg, 1);
      break;
    case Op::kRestore:
      memcpy(leg_, offsets_->data(), kOffsetsSize);
      begin_write(Job::kScript, step.reg, kOffsetsSize);
      break;
    case Op::kExpect:
      begin_read(Job::kScript, step.reg, leg_, 1);
      break;
    case Op::kCompare:
    case Op::kReadOffsets:
      begin_read(Job::kScript, step.reg, leg_, kOffsetsSize);
      break;
    case Op::kEnd:
      enter(ImuState::kRun);
      break;
  }
}

// What was read is what the step wants; offsets go to the store.
bool Bno055::check_step() {
  ScriptStep const step = step_of(state_, script_at_);
  switch (step.op) {
    case Op::kExpect:
      return (leg_[0] & (step.reg == kOprMode ? kModeMask : 0xFF)) ==
             step.value;
    case Op::kCompare:
      return memcmp(leg_, offsets_->data(), kOffsetsSize) == 0;
    case Op::kReadOffsets:
      if (!offsets_->loaded() ||
          memcmp(leg_, offsets_->data(), kOffsetsSize) != 0) {
        keep_offsets();
      }
      return true;
    default:
      return true;
  }
}

// While an older write is under way this boot's offsets are not kept.
void Bno055::keep_offsets() {
  if (!offsets_->saving()) {
    memcpy(offsets_->data(), leg_, kOffsetsSize);
    offsets_->save();
  }
}

void Bno055::script_done() {
  if (!check_step()) {
    if (step_of(state_, script_at_).op == Op::kCompare) {
      refused_ = true;  // better without our offsets than without the part
    }
    enter(ImuState::kReset);
    return;
  }
  uint8_t const wait_ms = step_of(state_, script_at_).wait_ms;
  ++script_at_;
  if (wait_ms != 0) {
    waiting_ = true;
    resume_ = now_ + ticks_of_ms(wait_ms);
  } else {
    run_script();
  }
}

}  // namespace dart
