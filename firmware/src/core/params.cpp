#include "params.h"

#include "crc16.h"

namespace dart {

namespace {

// Values are kept as u16; the baud rate, alone too large, in hundreds.
constexpr uint16_t kBaudId = static_cast<uint16_t>(wire::ParamId::kBaud);
constexpr uint8_t kBaudUnit = 100;
constexpr uint32_t kBauds[] = {115200, 500000};

constexpr bool fit_in_words(uint8_t i = 0) {
  return i == wire::kParamCount ||
         (wire::kParams[i].id == i + 1u &&
          (wire::kParams[i].id == kBaudId ||
           wire::kParams[i].high <= 0xFFFF) &&
          fit_in_words(static_cast<uint8_t>(i + 1)));
}
static_assert(fit_in_words(), "the id is the index, a value fits a word");

uint16_t packed(uint16_t id, uint32_t value) {
  return static_cast<uint16_t>(id == kBaudId ? value / kBaudUnit : value);
}

wire::ParamSpec spec_of(uint16_t id) {
  return rom_read(wire::kParams[id - 1]);
}

}  // namespace

bool Params::known(uint16_t id) { return id >= 1 && id <= wire::kParamCount; }

bool Params::allowed(wire::ParamSpec const& spec, uint32_t value) {
  if (spec.id == kBaudId) {
    return value == kBauds[0] || value == kBauds[1];
  }
  return value >= spec.low && value <= spec.high;
}

void Params::set_defaults() {
  for (uint16_t id = 1; id <= wire::kParamCount; ++id) {
    wire::detail::put(values_ + 2 * (id - 1), packed(id, spec_of(id).default_));
  }
}

bool Params::load() {
  bool good = store_.load();
  if (good) {
    // A record of another version may hold what this one does not allow.
    for (uint16_t id = 1; id <= wire::kParamCount; ++id) {
      good = good && allowed(spec_of(id), get(static_cast<wire::ParamId>(id)));
    }
  }
  if (!good) {
    set_defaults();
  }
  return good;
}

uint32_t Params::get(wire::ParamId param) const {
  uint16_t const id = static_cast<uint16_t>(param);
  if (!known(id)) {
    return 0;
  }
  uint16_t value;
  wire::detail::get(values_ + 2 * (id - 1), value);
  return id == kBaudId ? static_cast<uint32_t>(value) * kBaudUnit : value;
}

wire::ParamStatus Params::set(uint16_t id, uint32_t value) {
  if (!known(id)) {
    return wire::ParamStatus::kUnknownId;
  }
  if (!allowed(spec_of(id), value)) {
    return wire::ParamStatus::kOutOfRange;
  }
  if (unconfirmed_) {
    return wire::ParamStatus::kEepromBusy;
  }
  if (!store_.loaded() || get(static_cast<wire::ParamId>(id)) != value) {
    wire::detail::put(values_ + 2 * (id - 1), packed(id, value));
    store_.save();
  }
  unconfirmed_ = true;
  return wire::ParamStatus::kOk;
}

bool Params::step() {
  store_.step();
  bool const stored = unconfirmed_ && store_.at_rest();
  unconfirmed_ = unconfirmed_ && !stored;
  return stored;
}

uint16_t Params::crc() const { return crc16(0xFFFF, values_, kParamsSize); }

}  // namespace dart
