#include "twi.h"

#include "atomic.h"
#include "pins.h"

namespace dart {
namespace board {

namespace {

// Of the leg under way: written by the loop before START, by the interrupt
// after it.
struct Leg {
  uint8_t* data;
  uint8_t address;  // 7 bits
  uint8_t reg;
  uint8_t left;  // bytes of data
  bool reading;
  bool reg_sent;
};
Leg leg;
volatile BusStatus result = BusStatus::kDone;

constexpr uint8_t kOn = _BV(TWEN);
constexpr uint8_t kGo = _BV(TWEN) | _BV(TWIE) | _BV(TWINT);
constexpr uint8_t kStart = kGo | _BV(TWSTA);
// No interrupt after a STOP: there is none, TWSTO just falls.
constexpr uint8_t kStop = _BV(TWEN) | _BV(TWINT) | _BV(TWSTO);

// States of TWSR (master).
constexpr uint8_t kStarted = 0x08;
constexpr uint8_t kRestarted = 0x10;
constexpr uint8_t kWriteAck = 0x18;
constexpr uint8_t kWriteNack = 0x20;
constexpr uint8_t kDataAck = 0x28;
constexpr uint8_t kDataNack = 0x30;
constexpr uint8_t kReadAck = 0x40;
constexpr uint8_t kReadNack = 0x48;
constexpr uint8_t kGotByte = 0x50;
constexpr uint8_t kGotLast = 0x58;

inline void end(BusStatus status) {
  TWCR = kStop;
  result = status;
}

// The next byte of a write, or what follows its last.
inline void write_next() {
  if (!leg.reg_sent) {
    leg.reg_sent = true;
    TWDR = leg.reg;
    TWCR = kGo;
  } else if (leg.reading) {
    TWCR = kStart;
  } else if (leg.left != 0) {
    --leg.left;
    TWDR = *leg.data++;
    TWCR = kGo;
  } else {
    end(BusStatus::kDone);
  }
}

// All but the last byte are acknowledged.
inline void read_next() {
  TWCR = leg.left > 1 ? kGo | _BV(TWEA) : kGo;
}

inline void take_byte() {
  --leg.left;
  *leg.data++ = TWDR;
}

inline void on_event() {
  switch (TWSR & 0xF8) {
    case kStarted:
      TWDR = static_cast<uint8_t>(leg.address << 1);
      TWCR = kGo;
      break;
    case kRestarted:
      TWDR = static_cast<uint8_t>(leg.address << 1) | 1;
      TWCR = kGo;
      break;
    case kWriteAck:
    case kDataAck:
      write_next();
      break;
    case kReadAck:
      read_next();
      break;
    case kGotByte:
      take_byte();
      read_next();
      break;
    case kGotLast:
      take_byte();
      end(BusStatus::kDone);
      break;
    case kWriteNack:
    case kReadNack:
      end(BusStatus::kAddressNack);
      break;
    case kDataNack:
      end(BusStatus::kDataNack);
      break;
    default:  // arbitration lost (0x38) or bus error (0x00)
      end(BusStatus::kArbitration);
      break;
  }
}

// Open drain by hand: drive low or let go, never high.
inline void sda_low() { DDRC |= kSda; }
inline void sda_free() { DDRC &= static_cast<uint8_t>(~kSda); }
inline void scl_low() { DDRC |= kScl; }
inline void scl_free() { DDRC &= static_cast<uint8_t>(~kScl); }
inline bool sda_is_low() { return (PINC & kSda) == 0; }

// 5 us: half a period of 100 kHz, which every part follows.
inline void half_period() { __builtin_avr_delay_cycles(80); }

constexpr uint8_t kRecoveryClocks = 9;

}  // namespace

void Twi::set_clock(uint16_t khz) {
  // SCL = 16 MHz / (16 + 2 n); 400 kHz gives 12, 100 kHz 72.
  bit_rate_ = static_cast<uint8_t>((16000u / khz - 16u) / 2u);
}

void Twi::start(uint8_t address, uint8_t reg, uint8_t* data, uint8_t size,
                bool reading) {
  leg = {data, address, reg, size, reading, false};
  result = BusStatus::kBusy;
  TWCR = kStart;
}

void Twi::start_write(uint8_t address, uint8_t reg, uint8_t const* data,
                      uint8_t size) {
  // Only read_next() writes through the pointer.
  start(address, reg, const_cast<uint8_t*>(data), size, false);
}

void Twi::start_read(uint8_t address, uint8_t reg, uint8_t* data,
                     uint8_t size) {
  start(address, reg, data, size, true);
}

BusStatus Twi::poll() {
  // A line held low keeps TWSTO up: the caller's deadline ends that.
  if (result == BusStatus::kBusy || (TWCR & _BV(TWSTO)) != 0) {
    return BusStatus::kBusy;
  }
  return result;
}

void Twi::abort() {
  restart();
  result = BusStatus::kTimeout;
}

bool Twi::lines_low() { return (PINC & (kSda | kScl)) != (kSda | kScl); }

void Twi::restart() {
  TWCR = 0;
  TWSR = 0;
  TWBR = bit_rate_;
  TWCR = kOn;
}

void Twi::clear() {
  TWCR = 0;
  PORTC &= static_cast<uint8_t>(~(kSda | kScl));
  for (uint8_t i = 0; i < kRecoveryClocks && sda_is_low(); ++i) {
    scl_low();
    half_period();
    scl_free();
    half_period();
  }
  // STOP: SDA rises while SCL is high.
  scl_low();
  sda_low();
  half_period();
  scl_free();
  half_period();
  sda_free();
  half_period();
  restart();
}

void Twi::power(bool on) {
  TWCR = 0;
  PORTC &= static_cast<uint8_t>(~(kSda | kScl));
  if (on) {
    sda_free();
    scl_free();
    PORTD |= kImuPower;
    restart();
  } else {
    PORTD &= static_cast<uint8_t>(~kImuPower);
    sda_low();
    scl_low();
  }
}

}  // namespace board
}  // namespace dart

ISR(TWI_vect) { dart::board::on_event(); }
