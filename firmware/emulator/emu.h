/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * An Arduino Nano in simavr, with the parts around it that DART has: UART
 * line, BNO055, two encoder rings, pins. Public interface for ctypes.
 *
 * Times are MCU cycles since emu_new (u64); they run on through resets. A
 * call that changes an input takes effect at emu_now(). No function is safe
 * against use of one emulator from two threads at once.
 */
#ifndef DART_EMU_H
#define DART_EMU_H

#include <stdint.h>

#define EMU_ABI 5

typedef struct emu emu_t;

#pragma GCC visibility push(default)

/* Bits of the result of emu_run and emu_step. */
enum {
	EMU_DELIMITER = 1, /* stopped at the stop bit of a 0x00 of the UART */
	EMU_CRASHED = 2,   /* the program left its code; silent until a reset */
	EMU_RESET = 4,     /* watchdog or brown-out restarted the MCU meanwhile */
	EMU_BYTES = 8      /* emu_uart_read has something */
};

enum emu_cause { EMU_EXTERNAL, EMU_POWER, EMU_BROWNOUT, EMU_WATCHDOG };
enum emu_i2c_fault {
	EMU_I2C_OK, EMU_I2C_NACK, EMU_I2C_SDA, EMU_I2C_SCL, EMU_I2C_DEAD
};
enum emu_imu_fault {
	EMU_IMU_OK, EMU_IMU_OFF, EMU_IMU_STUCK, EMU_IMU_GARBAGE,
	EMU_IMU_WRONG,        /* value: gain of what it measures */
	EMU_IMU_SLOW,         /* value: updates per second */
	EMU_IMU_DELAYED,      /* value: s, at most 1.2 */
	EMU_IMU_INTERMITTENT, /* value: share of addresses not acknowledged */
	EMU_IMU_ZERO          /* all data read 0 */
};

int emu_abi(void);
const char *emu_simavr(void); /* version of the headers it was built with */

/* A powered Nano whose flash holds `image` from address 0 (n <= 32768),
 * starting at byte address reset_pc. NULL: out of memory or bounds. */
emu_t *emu_new(const uint8_t *image, uint32_t n, uint32_t reset_pc);
void emu_free(emu_t *e);
/* MCU cycles per second of the world from now on (16e6 (1 + error)). */
void emu_clock(emu_t *e, double hz);
void emu_reset(emu_t *e, int cause);
/* What lies between a reset and the program from the next reset on: in[0] s
 * of start-up, then in[1] s of bootloader after an external reset or in[2] s
 * after any other, all with released pins; in[3] != 0: it clears MCUSR. */
void emu_boot(emu_t *e, const double in[4]);

/* Advance to the absolute cycle `target`, at most to the next EMU_DELIMITER. */
int emu_run(emu_t *e, uint64_t target);
/* emu_wheel(in[0]), emu_imu(in[1..3], in[4..6]), then emu_run. */
int emu_step(emu_t *e, uint64_t target, const double in[7]);
uint64_t emu_now(const emu_t *e);

/* Host side of the line. Bytes of the MCU carry the cycle of their stop bit. */
int emu_uart_read(emu_t *e, uint8_t *buf, uint64_t *stamp, int max);
int emu_uart_write(emu_t *e, const uint8_t *buf, int n);
void emu_uart_baud(emu_t *e, double host_baud);
/* out: baud of the MCU, RX bytes delivered, overrun, garbled, TX bytes */
void emu_uart_stats(const emu_t *e, double out[5]);

/* Electrical noise on D2 (ring 0) or D3: edges per second (0 = none, at most
 * 2e6), evenly spaced or at random. */
int emu_chatter(emu_t *e, int ring, double edges_per_s, int irregular);
/* Ring 0 = D2, 1 = D3: marks in revolutions, sorted in [0, 1), n even. */
int emu_ring(emu_t *e, int ring, const double *mark, int n);
void emu_wheel(emu_t *e, double rev_per_s);
double emu_position(const emu_t *e); /* revolutions since emu_new */
uint64_t emu_edges(const emu_t *e, int ring); /* level changes at the pin */

/* BNO055: true rad/s and m/s^2 in sensor axes. */
void emu_imu(emu_t *e, const double gyro[3], const double lin[3]);
void emu_imu_fault(emu_t *e, int fault, double value);
void emu_imu_reset(emu_t *e); /* the part loses its supply for a moment */
void emu_imu_config(emu_t *e); /* it falls back to CONFIG, without a gap */
/* in: zero-rate error rad/s x3, zero-g error m/s^2 x3, relative error of its
 * clock, seconds until sys, gyr, acc are calibrated (< 0: never). */
void emu_imu_setup(emu_t *e, const double in[10]);
int emu_imu_peek(emu_t *e, int reg); /* register of page 0 */
/* p: share of transactions for NACK; stretch in us per byte; clocks: SCL
 * pulses by GPIO that free SDA (0: none do). */
void emu_i2c(emu_t *e, int fault, double p, double stretch_us, int clocks);

/* Pins by port letter 'B'..'D'. State: 0 low, 1 high, 2 not driven. */
void emu_pin(emu_t *e, int port, int bit, int level);
int emu_pin_state(const emu_t *e, int port, int bit);
/* D8 gets the level of emu_pin through the cut-off: low unless the MCU drives
 * D5 (multiplexer) or D6 (/OE) high; gate: 5 or 6, 0 if there is none. */
void emu_capture(emu_t *e, int gate);
/* A0: a voltage behind a resistance; ohm < 0: nothing is connected. */
void emu_divider(emu_t *e, double volt, double ohm);
int emu_pin_log(emu_t *e, uint64_t *cycle, uint8_t *pin, uint8_t *state,
		int max); /* pin = port letter - 'B' << 4 | bit; drains */

int emu_eeprom_get(emu_t *e, uint8_t *buf, int n);
int emu_eeprom_set(emu_t *e, const uint8_t *buf, int n);
/* The supply fails in the middle of the nth byte written from now on (0 =
 * not): that byte is garbled, and a brown-out resets the MCU. */
void emu_eeprom_tear(emu_t *e, int nth);
int emu_flash_get(const emu_t *e, uint8_t *buf, int n);

/* Interrupt vector v: out = count, min, max, total cycles, entry and reti
 * included. */
void emu_isr(const emu_t *e, int v, uint64_t out[4]);
int emu_mark(emu_t *e, uint64_t *cycle, uint8_t *value, int max); /* GPIOR0 */
/* out: lowest stack pointer use in bytes, bytes never touched */
void emu_stack(const emu_t *e, uint32_t out[2]);
int emu_peek(const emu_t *e, int address); /* data space */
void emu_poke(emu_t *e, int address, int value);
void emu_hang(emu_t *e, int on); /* main program stands, interrupts run */
void emu_freeze(emu_t *e, int on); /* interrupts are off as well */
void emu_vcc(emu_t *e, int millivolt); /* below 2.7 V: brown-out reset */
void emu_power(emu_t *e, int on); /* USB cable out: nothing is driven */
const char *emu_log(void); /* last message of simavr, "" = none */

#pragma GCC visibility pop

#endif
