// Version of the firmware, told in HELLO.
#ifndef DART_APP_VERSION_H
#define DART_APP_VERSION_H

#include <stdint.h>

#include "../core/wire.h"

namespace dart {
namespace app {

constexpr uint8_t kVersionMajor = 0;
constexpr uint8_t kVersionMinor = 1;
constexpr uint8_t kVersionPatch = 0;

// First 32 bits of the SHA-256 over the sources (see Makefile): the same
// sources give the same bytes, whatever the state of the checkout. An IDE
// build does not know it and says 0, dirty.
#if defined(DART_SOURCE_HASH)
constexpr uint32_t kSourceHash = DART_SOURCE_HASH;
#else
constexpr uint32_t kSourceHash = 0;
#endif

#if defined(DART_TEST)
constexpr uint8_t kTestFlag =
    static_cast<uint8_t>(wire::Build::kEmulatorTest);
#else
constexpr uint8_t kTestFlag = 0;
#endif

constexpr uint8_t kBuildFlags = static_cast<uint8_t>(
    kTestFlag |
    (kSourceHash == 0 ? static_cast<uint8_t>(wire::Build::kDirty) : 0));

}  // namespace app
}  // namespace dart

#endif  // DART_APP_VERSION_H
