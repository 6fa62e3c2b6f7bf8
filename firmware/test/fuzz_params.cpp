// libFuzzer: the parameter store between writes, power cuts and EEPROMs full
// of anything. Laws: a value in force is allowed; a cut loses at most the
// write under way; nothing touches an EEPROM that writes.
#include <string.h>

#include <new>

#include "../src/core/params.h"
#include "fuzz.h"

using namespace dart;

namespace {

constexpr uint16_t kPlace = 0xA0;  // both slots, 0x20 bytes each
constexpr uint16_t kSize = 0xE0;
constexpr uint8_t kPolls = 2;  // that a write takes: busy once

class Cells : public Eeprom {
 public:
  uint8_t cells[kSize];
  uint8_t busy_polls = 0;
  bool powered = true;
  uint16_t cut_after = 0xFFFF;  // writes until the supply fails

  uint8_t read(uint16_t address) override {
    LAW(address >= kPlace && address < kSize && busy_polls == 0);
    return cells[address];
  }
  bool busy() override {
    busy_polls = static_cast<uint8_t>(busy_polls - (busy_polls != 0));
    return busy_polls != 0;
  }
  void write(uint16_t address, uint8_t value) override {
    LAW(address >= kPlace && address < kSize && busy_polls == 0);
    if (!powered) {
      return;
    }
    if (cut_after-- == 0) {
      powered = false;
      cells[address] = static_cast<uint8_t>(value ^ 0xA5);  // half written
      return;
    }
    cells[address] = value;
    busy_polls = kPolls;
  }
};

struct Values {
  uint32_t of[wire::kParamCount];

  bool operator==(Values const& other) const {
    return memcmp(of, other.of, sizeof of) == 0;
  }
};

Values in_force(Params const& params) {
  Values values;
  for (uint16_t i = 0; i < wire::kParamCount; ++i) {
    wire::ParamSpec const& spec = wire::kParams[i];
    values.of[i] = params.get(static_cast<wire::ParamId>(spec.id));
    LAW(values.of[i] >= spec.low && values.of[i] <= spec.high);
  }
  return values;
}

// To the moment at which a host is told that the value is stored.
void settle(Params& params) {
  // Each byte of the record is written once, and asked for at most so often.
  bool stored = false;
  for (int i = 0; i < 64 * (kPolls + 2) && !stored; ++i) {
    stored = params.step();
  }
  LAW(stored);
}

Params& renewed(void* place, Cells& cells) {
  return *new (place) Params(cells);
}

void damage(Cells& cells, Input& input) {
  for (uint8_t n = input.byte() % 64; n != 0 && !input.empty(); --n) {
    uint16_t const at = static_cast<uint16_t>(kPlace + input.byte() % 0x40);
    cells.cells[at] = input.byte();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(uint8_t const* data, size_t size) {
  Input input = {data, size};
  Cells cells;
  memset(cells.cells + kPlace, 0xFF, 0x40);
  alignas(Params) uint8_t place[sizeof(Params)];
  Params* params = &renewed(place, cells);
  params->load();
  Values stored = in_force(*params);
  while (!input.empty()) {
    uint8_t const choice = input.byte();
    if (choice >= 0xF0) {  // somebody else has written there
      damage(cells, input);
      params = &renewed(place, cells);
      params->load();
      stored = in_force(*params);
      continue;
    }
    Values const before = in_force(*params);
    uint16_t const id = static_cast<uint16_t>(choice % 14);  // 0, 11 to 13: none
    uint32_t const value = input.byte() < 0x40
                               ? 100ul * input.word()
                               : static_cast<uint32_t>(input.word());
    wire::ParamStatus const status = params->set(id, value);
    if (status != wire::ParamStatus::kOk) {
      LAW(in_force(*params) == before);
      continue;
    }
    LAW(Params::known(id) && params->get(static_cast<wire::ParamId>(id)) == value);
    Values const wanted = in_force(*params);
    bool const cut = choice >= 0x80;
    if (cut) {
      cells.cut_after = input.byte() % 32;
    }
    settle(*params);
    bool const survived = cells.powered;
    cells.powered = true;
    cells.cut_after = 0xFFFF;
    cells.busy_polls = 0;
    params = &renewed(place, cells);
    bool const loaded = params->load();
    Values const now = in_force(*params);
    LAW(survived ? loaded && now == wanted : now == wanted || now == stored);
    stored = now;
  }
  return 0;
}
