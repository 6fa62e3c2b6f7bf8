#include "uart.h"

#include "atomic.h"
#include "clock.h"

namespace dart {
namespace board {

namespace {

//        tail            head         free = tail - head - 1
//   ......[ a b c d e f ]......       empty: head == tail
//
// The interrupt owns rx.head and tx.tail, the loop owns the other two; an
// index is one byte, so reading the other side's needs no lock.

// 2.5 ms at 500000 baud: the loop looks at least every millisecond.
constexpr uint8_t kRxSize = 128;
constexpr uint8_t kRxMask = kRxSize - 1;
uint8_t rx_ring[kRxSize];
volatile uint8_t rx_head;
volatile uint8_t rx_tail;

// Two frames: STATE (44) and the longest other (56).
constexpr uint8_t kTxSize = 128;
constexpr uint8_t kTxMask = kTxSize - 1;
uint8_t tx_ring[kTxSize];
volatile uint8_t tx_head;
volatile uint8_t tx_tail;
volatile uint8_t tx_count;
volatile bool tx_used_once;

// Times of the last delimiters: a ring full holds 10 frames of 12 bytes, but
// the loop is at most 1 ms behind, in which 5 arrive.
constexpr uint8_t kStamps = 8;
uint16_t rx_stamps[kStamps];
volatile uint8_t rx_delimiters;
uint8_t rx_delimiters_read;

volatile uint8_t rx_framing;
volatile uint8_t rx_overrun;

inline uint8_t tx_used() {
  return static_cast<uint8_t>(tx_head - tx_tail) & kTxMask;
}

// The compiler must not publish an index before the bytes it speaks for.
inline void barrier() { __asm__ volatile("" ::: "memory"); }

void tx_push(uint8_t const* data, uint8_t size) {
  uint8_t head = tx_head;
  for (uint8_t i = 0; i < size; ++i) {
    tx_ring[head] = data[i];
    head = static_cast<uint8_t>(head + 1) & kTxMask;
  }
  barrier();
  tx_head = head;
}

}  // namespace

void uart_start(Baud baud) {
  Atomic const lock;
  UCSR0B = 0;
  UCSR0A = _BV(U2X0);
  // 16 MHz / 8 / (n + 1): 2 MHz / 4 = 500000, 2 MHz / 17 = 117647.
  UBRR0 = baud == Baud::k500000 ? 3 : 16;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  tx_head = tx_tail = 0;
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

bool uart_waiting() { return rx_tail != rx_head; }

bool uart_read(RxByte& byte) {
  if (rx_tail == rx_head) {
    return false;
  }
  byte.value = rx_ring[rx_tail];
  if (byte.value == 0) {
    Atomic const lock;
    byte.stamp = rx_stamps[rx_delimiters_read % kStamps];
    rx_delimiters_read = static_cast<uint8_t>(rx_delimiters_read + 1);
  }
  barrier();
  rx_tail = static_cast<uint8_t>(rx_tail + 1) & kRxMask;
  return true;
}

bool uart_write(uint8_t const* data, uint8_t size) {
  if (size > static_cast<uint8_t>(kTxMask - tx_used())) {
    return false;
  }
  tx_push(data, size);
  Atomic const lock;
  UCSR0B = static_cast<uint8_t>(UCSR0B | _BV(UDRIE0));
  return true;
}

bool uart_idle() {
  Atomic const lock;
  if (tx_used() != 0 || (UCSR0A & _BV(UDRE0)) == 0) {
    return false;
  }
  // TXC0 is set when the shift register has run empty; nothing was ever
  // sent before the first byte.
  return (UCSR0A & _BV(TXC0)) != 0 || !tx_used_once;
}

bool uart_write_at(uint8_t const* data, uint8_t size, Tick start) {
  if (!uart_idle()) {
    return false;
  }
  tx_push(data + 1, static_cast<uint8_t>(size - 1));
  // From the last look to the write, half of the time between two looks
  // included: measured in the emulator, held by a test.
  constexpr Tick kLookToWrite = 14;
  // Every look takes more than 2 ticks, so this bounds the wait as well.
  for (uint16_t looks = 0; looks < kMaxStartWait / 2; ++looks) {
    if (reached(now(), start - kLookToWrite)) {
      break;
    }
  }
  Atomic const lock;
  UCSR0A = _BV(U2X0) | _BV(TXC0);
  UDR0 = data[0];
  tx_used_once = true;
  tx_count = static_cast<uint8_t>(tx_count + 1);
  UCSR0B = static_cast<uint8_t>(UCSR0B | _BV(UDRIE0));
  return true;
}

UartErrors uart_errors() { return {rx_framing, rx_overrun}; }

uint8_t uart_sent() { return tx_count; }

}  // namespace board
}  // namespace dart

ISR(USART_RX_vect) {
  using namespace dart::board;
  uint8_t const status = UCSR0A;  // before UDR0, which drops the flags
  uint8_t const byte = UDR0;
  if ((status & _BV(FE0)) != 0) {
    rx_framing = static_cast<uint8_t>(rx_framing + 1);
  }
  uint8_t const head = rx_head;
  uint8_t const next = static_cast<uint8_t>(head + 1) & kRxMask;
  if ((status & _BV(DOR0)) != 0 || next == rx_tail) {
    rx_overrun = static_cast<uint8_t>(rx_overrun + 1);
  }
  if (next == rx_tail) {
    return;
  }
  rx_ring[head] = byte;
  rx_head = next;
  if (byte == 0) {
    uint8_t const n = rx_delimiters;
    rx_stamps[n % kStamps] = now_low();
    rx_delimiters = static_cast<uint8_t>(n + 1);
  }
}

ISR(USART_UDRE_vect) {
  using namespace dart::board;
  uint8_t const tail = tx_tail;
  if (tail == tx_head) {
    UCSR0B = static_cast<uint8_t>(UCSR0B & ~_BV(UDRIE0));
    return;
  }
  // TXC0 is cleared with the byte, so that it tells of this one.
  UCSR0A = _BV(U2X0) | _BV(TXC0);
  UDR0 = tx_ring[tail];
  tx_used_once = true;
  uint8_t const next = static_cast<uint8_t>(tail + 1) & kTxMask;
  tx_tail = next;
  tx_count = static_cast<uint8_t>(tx_count + 1);
  if (next == tx_head) {
    UCSR0B = static_cast<uint8_t>(UCSR0B & ~_BV(UDRIE0));
  }
}
