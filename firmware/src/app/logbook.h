// LOG frames: a few fixed sentences, kept in flash.
#ifndef DART_APP_LOGBOOK_H
#define DART_APP_LOGBOOK_H

#include <stdint.h>

namespace dart {
namespace app {

enum class LogLine : uint8_t {
  kNewBoard = 0,
  kParamDefaults = 1,
  kFactoryOffsets = 2,
  kBaudChanged = 3,
  kWatchdog = 4,
};
constexpr uint8_t kLogLines = 5;

// Says it once, when the line has room for it.
void log_line(LogLine line);

// Sends the next waiting sentence, if any.
void send_log();

}  // namespace app
}  // namespace dart

#endif  // DART_APP_LOGBOOK_H
