/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * TWI master in place of simavr's, which ignores TWBR, and the two lines.
 *
 * An operation ends (TWINT) after its SCL periods of 16 + 2 TWBR 4^TWPS
 * cycles: one for START and STOP, nine for a byte, plus the time for which
 * the slave stretches. While SDA or SCL is held an operation just waits.
 */
#include "core.h"

#define TWBR 0xB8
#define TWSR 0xB9
#define TWDR 0xBB
#define TWCR 0xBC
#define TWINT 0x80
#define TWEA 0x40
#define TWSTA 0x20
#define TWSTO 0x10
#define TWWC 0x08
#define TWEN 0x04
#define TWIE 0x01
#define SDA_BIT 4
#define SCL_BIT 5

enum { IDLE, START, ADDRESS, WRITE, READ, STOP };
enum {
	S_START = 0x08, S_RESTART = 0x10, S_LOST = 0x38, S_NOTHING = 0xF8
};

static uint8_t status(const emu_t *e)
{
	return e->avr->data[TWSR] & 0xF8;
}

static void set_status(emu_t *e, uint8_t s)
{
	e->avr->data[TWSR] = (uint8_t)((e->avr->data[TWSR] & 3) | s);
}

static double period(const emu_t *e)
{
	const uint8_t *d = e->avr->data;

	return 16.0 + 2.0 * d[TWBR] * (1 << 2 * (d[TWSR] & 3));
}

static bool chance(struct twi *w)
{
	return noise_next(&w->noise) / 4294967296.0 < w->p;
}

static bool refused(struct twi *w)
{
	if (w->fault == EMU_I2C_DEAD)
		return true;
	return w->fault == EMU_I2C_NACK && chance(w);
}

static bool held(const struct twi *w, int op)
{
	if (w->fault == EMU_I2C_SCL)
		return true;
	return w->fault == EMU_I2C_SDA && (op == START || op == STOP);
}

static void begin(emu_t *e, int op, double cycles)
{
	e->twi.op = op;
	e->twi.waiting = false;
	emu_at(e, EV_TWI, e->avr->cycle + (uint64_t)cycles);
}

static double stretch(const emu_t *e)
{
	return e->twi.stretch_us * 1e-6 * e->hz;
}

/* What follows TWINT = 1 without START or STOP. */
static void proceed(emu_t *e)
{
	uint8_t v = e->avr->data[TWDR];
	double byte = 9 * period(e);

	switch (status(e)) {
	case S_START:
	case S_RESTART:
		e->twi.reading = v & 1;
		e->twi.ours = v >> 1 == 0x28 && !refused(&e->twi) &&
			      bno_address(&e->imu, v & 1,
					  emu_world(e, e->avr->cycle));
		begin(e, ADDRESS, byte + (e->twi.ours ? stretch(e) : 0));
		break;
	case S_LOST:
	case S_NOTHING:
		break;
	default:
		begin(e, e->twi.reading ? READ : WRITE,
		      byte + (e->twi.ours ? stretch(e) : 0));
	}
}

static void request(emu_t *e, uint8_t v, bool go)
{
	if (v & TWSTO && e->twi.owned)
		begin(e, STOP, period(e));
	else if (v & TWSTA)
		begin(e, START, period(e));
	else if (v & TWSTO) /* no bus to stop: hardware just clears the bit */
		e->avr->data[TWCR] &= (uint8_t)~TWSTO;
	else if (go && e->twi.owned)
		proceed(e);
}

/* --- end of an operation ----------------------------------------------- */

static uint8_t end_address(emu_t *e)
{
	if (e->twi.fault == EMU_I2C_SDA)
		return S_LOST;
	if (e->twi.reading)
		return e->twi.ours ? 0x40 : 0x48;
	return e->twi.ours ? 0x18 : 0x20;
}

static uint8_t end_write(emu_t *e, double t)
{
	uint8_t v = e->avr->data[TWDR];
	bool ack;

	if (e->twi.fault == EMU_I2C_SDA)
		return v ? S_LOST : 0x28;
	ack = e->twi.ours && !refused(&e->twi) && bno_write(&e->imu, v, t);
	emu_at(e, EV_IMU, emu_cycle(e, e->imu.next)); /* a reset moves it */
	return ack ? 0x28 : 0x30;
}

static uint8_t end_read(emu_t *e)
{
	bool ack = e->avr->data[TWCR] & TWEA;

	if (e->twi.fault == EMU_I2C_SDA) {
		e->avr->data[TWDR] = 0;
		return ack ? 0x50 : S_LOST;
	}
	e->avr->data[TWDR] = e->twi.ours && e->twi.fault != EMU_I2C_DEAD ?
			     bno_read(&e->imu) : 0xFF;
	return ack ? 0x50 : 0x58;
}

static void end_stop(emu_t *e)
{
	avr_t *avr = e->avr;

	e->twi.owned = e->twi.ours = false;
	avr->data[TWCR] &= (uint8_t)~TWSTO;
	set_status(e, S_NOTHING);
	if (avr->data[TWCR] & TWSTA)
		begin(e, START, period(e));
}

void twi_event(emu_t *e)
{
	struct twi *w = &e->twi;
	double t = emu_world(e, e->when[EV_TWI]);
	int op = w->op;
	uint8_t s;

	emu_at(e, EV_TWI, NEVER);
	if (held(w, op)) {
		w->waiting = true;
		return;
	}
	w->op = IDLE;
	switch (op) {
	case START:
		s = w->owned ? S_RESTART : S_START;
		w->owned = true;
		w->ours = false;
		break;
	case ADDRESS: s = end_address(e); break;
	case WRITE: s = end_write(e, t); break;
	case READ: s = end_read(e); break;
	default: end_stop(e); return;
	}
	if (s == S_LOST)
		w->owned = w->ours = false;
	set_status(e, s);
	avr_raise_interrupt(e->avr, &w->io->twi);
}

/* --- registers --------------------------------------------------------- */

static void abort_all(emu_t *e)
{
	e->twi.op = IDLE;
	e->twi.waiting = e->twi.owned = e->twi.ours = false;
	emu_at(e, EV_TWI, NEVER);
	avr_clear_interrupt(e->avr, &e->twi.io->twi);
	set_status(e, S_NOTHING);
}

static void gpio(emu_t *e);

static void twcr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	avr_int_vector_t *vector = &e->twi.io->twi;
	uint8_t old = avr->data[addr], flag = old & TWINT;
	bool go = v & TWINT && flag;

	if (!(v & TWEN)) {
		abort_all(e);
		avr->data[addr] = v & (TWEA | TWIE);
		gpio(e);
		return;
	}
	if (go) {
		avr_clear_interrupt(avr, vector);
		flag = 0;
	}
	/* a STOP under way is not taken back by writing 0 */
	avr->data[addr] = (uint8_t)((v & (TWEA | TWSTA | TWSTO | TWEN | TWIE)) |
				    (e->twi.op == STOP ? TWSTO : 0) |
				    (old & TWWC) | flag);
	if (!(old & TWEN))
		gpio(e);
	if (e->twi.op == IDLE && !flag)
		request(e, v, go);
	if (flag && v & TWIE && !vector->pending)
		avr_raise_interrupt(avr, vector);
}

static void twdr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	(void)param;
	if (!(avr->data[TWCR] & TWINT)) {
		avr->data[TWCR] |= TWWC;
		return;
	}
	avr->data[TWCR] &= (uint8_t)~TWWC;
	avr->data[addr] = v;
}

static void twsr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	(void)param;
	avr->data[addr] = (uint8_t)((avr->data[addr] & 0xF8) | (v & 3));
}

/* --- lines ------------------------------------------------------------- */

static void release_waiting(emu_t *e)
{
	if (e->twi.waiting && !held(&e->twi, e->twi.op))
		begin(e, e->twi.op, period(e));
}

static void show_lines(emu_t *e)
{
	struct twi *w = &e->twi;
	bool gpio = !(e->avr->data[TWCR] & TWEN);
	bool sda = w->fault != EMU_I2C_SDA, scl = w->fault != EMU_I2C_SCL;

	if (gpio) {
		sda = sda && e->state[1][SDA_BIT] != 0;
		scl = scl && e->state[1][SCL_BIT] != 0;
	}
	if (sda != w->sda)
		pins_input(e, 1, SDA_BIT, w->sda = sda);
	if (scl != w->scl)
		pins_input(e, 1, SCL_BIT, w->scl = scl);
}

/* PORTC or DDRC changed, or the TWI gave the lines back. A slave that lost
 * count of its byte frees SDA after enough clocks. */
static void gpio(emu_t *e)
{
	struct twi *w = &e->twi;
	bool low = !(e->avr->data[TWCR] & TWEN) && e->state[1][SCL_BIT] == 0;

	if (low && !w->scl_driven_low && w->fault == EMU_I2C_SDA &&
	    w->release_after && ++w->clocks >= w->release_after)
		w->fault = EMU_I2C_OK;
	w->scl_driven_low = low;
	show_lines(e);
	release_waiting(e);
}

static void line_driven(emu_t *e, int state)
{
	(void)state;
	gpio(e);
}

void emu_i2c(emu_t *e, int fault, double p, double stretch_us, int clocks)
{
	struct twi *w = &e->twi;

	w->fault = fault;
	w->p = p;
	w->stretch_us = stretch_us;
	w->release_after = clocks;
	w->clocks = 0;
	show_lines(e);
	release_waiting(e);
}

int twi_init(emu_t *e)
{
	static const struct { int reg; avr_io_write_t write; } own[] = {
		{TWBR, NULL}, {TWSR, twsr_write}, {TWDR, twdr_write},
		{TWCR, twcr_write},
	};

	e->twi.io = emu_module(e, "twi", 0);
	if (!e->twi.io)
		return 0;
	for (unsigned i = 0; i < sizeof own / sizeof *own; i++) {
		int io = AVR_DATA_TO_IO(own[i].reg);

		e->avr->io[io].r.c = NULL;
		e->avr->io[io].w.c = own[i].write;
		e->avr->io[io].w.param = e;
	}
	e->twi.noise = 0x2545F491u;
	e->twi.stretch_us = 180;
	e->twi.sda = e->twi.scl = true;
	e->hangs[1][SDA_BIT] = e->hangs[1][SCL_BIT] = line_driven;
	return 1;
}

void twi_after_reset(emu_t *e)
{
	uint8_t *d = e->avr->data;

	abort_all(e);
	d[TWBR] = d[TWCR] = 0;
	d[TWSR] = S_NOTHING;
	d[TWDR] = 0xFF;
	e->twi.scl_driven_low = false;
	pins_input(e, 1, SDA_BIT, e->twi.sda);
	pins_input(e, 1, SCL_BIT, e->twi.scl);
	show_lines(e);
}
