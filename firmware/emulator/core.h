/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * What the files of the bridge know of each other.
 */
#ifndef DART_EMU_CORE_H
#define DART_EMU_CORE_H

#include <stdbool.h>
#include <stddef.h>

#include <simavr/sim_avr.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_twi.h>
#include <simavr/avr_uart.h>
#include <simavr/avr_watchdog.h>

#include "bno055.h"
#include "emu.h"

#define NEVER UINT64_MAX
#define FLASH_SIZE 32768u
#define VECTORS 26
#define RING_MARKS 128
#define LOG_SIZE 8192 /* power of two */

/* Our own events; at the same cycle they run in this order. */
enum {
	EV_TX, EV_RX, EV_TWI, EV_RING_A, EV_RING_B, EV_NOISE_A, EV_NOISE_B,
	EV_EEPROM, EV_BOOT, EV_WATCHDOG, EV_IMU, EV_COUNT
};

struct isr_stat {
	struct emu *e;
	uint64_t start, count, min, max, total;
};

struct ring {
	double mark[RING_MARKS];
	int n;
	int64_t k; /* index of the next mark ahead, k = revolution * n + i */
	uint64_t edges;
	int level; /* what the sensor shows */
	/* electrical noise on the wire: the pin has level ^ flipped */
	int flipped;
	double noise_step, noise_at; /* mean cycles between two edges */
	bool irregular;
	uint32_t noise;
};

struct uart {
	avr_uart_t *io;
	double host_bit; /* cycles */
	bool shifting, buffered;
	uint8_t tx_buffer;
	double tx_end; /* stop bit of the byte in the shift register */
	uint64_t stop; /* the same if that byte is 0x00 for the host */
	double host_busy;
	uint8_t *out;
	uint64_t *out_at;
	size_t out_n, out_cap, out_read;
	uint8_t fifo[2];
	bool fifo_fe[2];
	int fifo_n;
	uint8_t *in;
	size_t in_n, in_cap, in_read;
	double in_end;
	uint32_t noise;
	uint64_t received, overrun, garbled, sent;
};

struct twi {
	avr_twi_t *io;
	int op;
	bool waiting, owned, reading, arbitration_lost;
	bool ours; /* the BNO055 is addressed */
	int fault, release_after, clocks;
	double p, stretch_us;
	uint32_t noise;
	bool scl, sda; /* line levels */
	bool scl_driven_low;
};

struct event_log {
	uint64_t cycle[LOG_SIZE];
	uint8_t what[LOG_SIZE], value[LOG_SIZE];
	uint32_t head, tail;
};

/* What the MCU makes of a pin. */
enum { PIN_LOW, PIN_HIGH, PIN_RELEASED };

struct emu {
	avr_t *avr;
	avr_ioport_t *port[3];
	uint64_t now;
	uint64_t when[EV_COUNT], next_event;
	uint64_t limit, gate;
	bool hang;   /* the main program stands, interrupts run */
	bool frozen; /* all of it stands, interrupts are off */
	uint8_t frozen_i; /* the I bit before */
	bool held;   /* in reset or in the bootloader's wait: pins released */
	bool unpowered, low_supply;
	bool torn; /* the supply failed during an EEPROM write */
	struct {
		double startup, external, other; /* s */
		bool clears; /* MCUSR, before the program sees it */
	} boot;
	/* world time = world_t + (cycle - world_c) / hz */
	double hz, world_t;
	uint64_t world_c;
	struct eeprom {
		avr_eeprom_t *io;
		avr_io_write_t write; /* simavr's, of EECR */
		uint64_t done;        /* end of the write under way */
		uint16_t address;     /* its byte */
		int tear;             /* the n-th write from now is cut, 0 = none */
		bool cut;             /* this one */
		uint32_t noise;
	} eeprom;
	struct {
		avr_watchdog_t *io;
		uint64_t since, open_until;
		bool bitten; /* asks the run loop for a reset */
	} watchdog;
	struct {
		avr_timer_t *io;
		avr_io_write_t write; /* simavr's, of TCCR1A */
		void *param;
		uint8_t latch[2]; /* OC1A, OC1B: what compare matches left */
	} timer1;
	struct uart uart;
	struct twi twi;
	struct bno055 imu;
	struct ring ring[2];
	double wheel_pos, wheel_rate; /* revolutions, per cycle */
	uint64_t wheel_c;
	uint8_t state[3][8];
	/* who is told when the MCU drives a pin otherwise than before */
	void (*hangs[3][8])(emu_t *e, int state);
	/* what pin `bit` of port B carries, when PORTB says port_level */
	int (*drives_b)(const emu_t *e, int bit, int port_level);
	struct {
		int gate; /* D8 gets its level while D5 or D6 is high; 0: always */
		bool level;
	} capture;
	struct {
		avr_irq_t *input;
		double mv, ohm; /* behind A0; ohm < 0: not connected */
		uint32_t noise;
	} divider;
	struct event_log pins, marks;
	struct isr_stat isr[VECTORS];
};

/* base.c, below all parts */
void emu_gate(emu_t *e);
void emu_at(emu_t *e, int event, uint64_t when);
double emu_world(const emu_t *e, uint64_t cycle);
uint64_t emu_cycle(const emu_t *e, double world); /* rounded up */
void *emu_module(emu_t *e, const char *kind, int nth);
uint32_t noise_next(uint32_t *state);

/* Each part: set up once, after each reset, at its event. emu.c and reset.c
 * stand above the parts; the parts tell each other nothing but levels of pins. */
void reset_event(emu_t *e); /* the wait of the bootloader is over */

int uart_init(emu_t *e);
void uart_after_reset(emu_t *e);
void uart_tx_event(emu_t *e);
void uart_rx_event(emu_t *e);
void uart_free(emu_t *e);

int twi_init(emu_t *e);
void twi_after_reset(emu_t *e);
void twi_event(emu_t *e);

int pins_init(emu_t *e);
void pins_after_reset(emu_t *e); /* released; pins_settle when all are */
void pins_settle(emu_t *e);
void pins_input(emu_t *e, int port, int bit, int level);
void pins_show(emu_t *e, int port, int bit, uint8_t ddr, int port_level);

/* compare.c: D9 and D10 as outputs of Timer1 */
int compare_init(emu_t *e);
void compare_after_reset(emu_t *e);
int timer_flags_init(emu_t *e);

int watchdog_init(emu_t *e);
void watchdog_after_reset(emu_t *e);
void watchdog_event(emu_t *e);

int wheel_init(emu_t *e);
void wheel_after_reset(emu_t *e);
void wheel_event(emu_t *e, int ring);
void wheel_clock(emu_t *e, double old_hz);
void wheel_noise(emu_t *e, int ring);

int divider_init(emu_t *e); /* after pins_init */

int imu_init(emu_t *e);
void imu_event(emu_t *e);

int eeprom_init(emu_t *e);
void eeprom_event(emu_t *e);
void eeprom_supply_lost(emu_t *e);

/* probe.c: what is measured */
int probe_init(emu_t *e);
void log_put(struct event_log *log, uint64_t cycle, int what, int value);
int log_get(struct event_log *log, uint64_t *cycle, uint8_t *what,
	    uint8_t *value, int max);

#endif
