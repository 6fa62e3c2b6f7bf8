#include "logbook.h"

#include "../core/rom.h"
#include "link.h"

namespace dart {
namespace app {

namespace {

constexpr uint8_t kLongest = 33;
static_assert(kLongest < wire::Log::kSize, "one byte is the level");

enum Level : uint8_t { kInfo = 1, kWarning = 2 };

struct Sentence {
  Level level;
  char text[kLongest + 1];
};

constexpr Sentence kSentences[] DART_ROM = {
    {kInfo, "new board: id made and stored"},
    {kInfo, "no parameters stored: defaults"},
    {kInfo, "no IMU offsets stored: factory's"},
    {kWarning, "no valid frame: line rate toggled"},
    {kWarning, "the watchdog ended the last run"},
};
static_assert(sizeof kSentences / sizeof kSentences[0] == kLogLines,
              "every line has a sentence");

uint8_t waiting;  // bit per line

uint8_t copy_text(Sentence const& sentence, uint8_t* out) {
  uint8_t n = 0;
  for (; n < kLongest; ++n) {
    uint8_t const c = rom_byte(&sentence.text[n]);
    if (c == 0) {
      break;
    }
    out[n] = c;
  }
  return n;
}
static_assert(kLogLines <= 8, "bits of `waiting`");

}  // namespace

void log_line(LogLine line) {
  waiting = static_cast<uint8_t>(waiting | 1u << static_cast<uint8_t>(line));
}

void send_log() {
  for (uint8_t i = 0; i < kLogLines; ++i) {
    uint8_t const bit = static_cast<uint8_t>(1u << i);
    if ((waiting & bit) == 0) {
      continue;
    }
    waiting = static_cast<uint8_t>(waiting & ~bit);
    Outgoing out;
    out.payload[0] = rom_byte(&kSentences[i].level);
    uint8_t const n = copy_text(kSentences[i], out.payload + 1);
    send_payload(out, wire::Log::kId, wire::Log::kSeed,
                 static_cast<uint8_t>(1 + n));
    return;
  }
}

}  // namespace app
}  // namespace dart
