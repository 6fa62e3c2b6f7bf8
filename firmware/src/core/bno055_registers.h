// Registers of the BNO055, page 0 (Bosch BST-BNO055-DS000).
#ifndef DART_CORE_BNO055_REGISTERS_H
#define DART_CORE_BNO055_REGISTERS_H

#include <stdint.h>

namespace dart {
namespace bno055 {

constexpr uint8_t kAddress = 0x28;     // ADR pin low
constexpr uint8_t kAddressAlt = 0x29;  // ADR pin high

constexpr uint8_t kChipId = 0x00;
constexpr uint8_t kPageId = 0x07;
constexpr uint8_t kGyroX = 0x14;
constexpr uint8_t kGyroZ = 0x18;
constexpr uint8_t kLinAccX = 0x28;
constexpr uint8_t kCalibStat = 0x35;
constexpr uint8_t kSysStatus = 0x39;
constexpr uint8_t kUnitSel = 0x3B;
constexpr uint8_t kOprMode = 0x3D;
constexpr uint8_t kPwrMode = 0x3E;
constexpr uint8_t kSysTrigger = 0x3F;
constexpr uint8_t kOffsets = 0x55;

constexpr uint8_t kChipIdValue = 0xA0;
// Gyro in rad/s x 900, acceleration in m/s^2 x 100.
constexpr uint8_t kUnits = 0x02;
constexpr uint8_t kModeConfig = 0x00;
// Gyro and accelerometer fused: no magnetometer next to a motor.
constexpr uint8_t kModeImuPlus = 0x08;
// Bits 7 to 4 are reserved: a part may read them as it likes.
constexpr uint8_t kModeMask = 0x0F;
constexpr uint8_t kTriggerReset = 0x20;
constexpr uint8_t kSystemError = 1;

// CALIB_STAT: 2 bits each, sys gyr acc mag from the top.
inline bool fully_calibrated(uint8_t calib) { return (calib & 0x3C) == 0x3C; }

}  // namespace bno055
}  // namespace dart

#endif  // DART_CORE_BNO055_REGISTERS_H
