/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * USART0 in place of simavr's, and the host's end of the line.
 *
 * Transmit: one shift register and one buffer, ten bits of (UBRR + 1) x 8 or
 * 16 cycles, back to back. Receive: a byte per ten bits of the host, two
 * unread bytes at most; a third is lost and DOR is set. When the two rates
 * differ by more than 4 % both sides read noise.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"

#define UCSRA 0xC0
#define UCSRB 0xC1
#define UCSRC 0xC2
#define UBRRL 0xC4
#define UBRRH 0xC5
#define UDR 0xC6
#define U2X 0x02
#define DOR 0x08
#define FE 0x10
#define UDRE 0x20
#define TXC 0x40
#define RXC 0x80
#define MPCM 0x01
#define RXEN 0x10
#define TXEN 0x08
#define OUT_MAX (1u << 20)

static double mcu_bit(const emu_t *e)
{
	const uint8_t *d = e->avr->data;
	unsigned ubrr = d[UBRRL] | (d[UBRRH] & 0x0Fu) << 8;

	return (ubrr + 1) * (d[UCSRA] & U2X ? 8.0 : 16.0);
}

static bool matched(const emu_t *e)
{
	return fabs(mcu_bit(e) / e->uart.host_bit - 1) <= 0.04;
}

/* --- MCU to host ------------------------------------------------------- */

static bool out_room(struct uart *u)
{
	size_t cap = u->out_cap ? 2 * u->out_cap : 1024;
	uint8_t *out;
	uint64_t *at;

	if (u->out_n < u->out_cap)
		return true;
	if (u->out_read == u->out_n)
		u->out_read = u->out_n = 0;
	if (u->out_n < u->out_cap || cap > OUT_MAX)
		return u->out_n < u->out_cap;
	out = realloc(u->out, cap);
	if (out)
		u->out = out;
	at = realloc(u->out_at, cap * sizeof *at);
	if (at)
		u->out_at = at;
	if (!out || !at)
		return false;
	u->out_cap = cap;
	return true;
}

/* The byte as the host's receiver sees it; false = it sees nothing. */
static bool as_seen(emu_t *e, uint8_t *v, double start)
{
	struct uart *u = &e->uart;

	if (matched(e))
		return true;
	u->garbled++;
	*v ^= (uint8_t)(noise_next(&u->noise) >> 11);
	if (start < u->host_busy)
		return false;
	u->host_busy = start + 10 * u->host_bit;
	return true;
}

static void shift_out(emu_t *e, uint8_t v, double start)
{
	struct uart *u = &e->uart;
	uint64_t end;

	u->shifting = true;
	u->tx_end = start + 10 * mcu_bit(e);
	u->sent++;
	end = (uint64_t)ceil(u->tx_end);
	if (as_seen(e, &v, start) && out_room(u)) {
		u->out[u->out_n] = v;
		u->out_at[u->out_n++] = end;
		if (v == 0)
			u->stop = end;
	}
	emu_at(e, EV_TX, end);
}

static void udr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	struct uart *u = &e->uart;

	(void)addr;
	if (!(avr->data[UCSRB] & TXEN) || u->buffered)
		return;
	if (u->shifting) {
		u->buffered = true;
		u->tx_buffer = v;
		avr_clear_interrupt(avr, &u->io->udrc);
		avr->data[UCSRA] &= (uint8_t)~UDRE;
		return;
	}
	shift_out(e, v, (double)avr->cycle);
	/* the buffer is free again: an enabled interrupt fires once more */
	if (!u->io->udrc.pending)
		avr_raise_interrupt(avr, &u->io->udrc);
}

void uart_tx_event(emu_t *e)
{
	struct uart *u = &e->uart;

	e->when[EV_TX] = NEVER;
	u->shifting = false;
	if (u->buffered) {
		u->buffered = false;
		shift_out(e, u->tx_buffer, u->tx_end);
		if (!u->io->udrc.pending)
			avr_raise_interrupt(e->avr, &u->io->udrc);
		return;
	}
	emu_at(e, EV_TX, NEVER);
	if (!u->io->txc.pending)
		avr_raise_interrupt(e->avr, &u->io->txc);
}

int emu_uart_read(emu_t *e, uint8_t *buf, uint64_t *stamp, int max)
{
	struct uart *u = &e->uart;
	int n = 0;

	while (n < max && u->out_read < u->out_n &&
	       u->out_at[u->out_read] <= e->now) {
		stamp[n] = u->out_at[u->out_read];
		buf[n++] = u->out[u->out_read++];
	}
	if (u->out_read == u->out_n)
		u->out_read = u->out_n = 0;
	return n;
}

/* --- host to MCU ------------------------------------------------------- */

static void show_head(emu_t *e)
{
	struct uart *u = &e->uart;
	uint8_t a = e->avr->data[UCSRA] & (uint8_t)~(RXC | FE);

	if (u->fifo_n)
		a |= (uint8_t)(RXC | (u->fifo_fe[0] ? FE : 0));
	e->avr->data[UCSRA] = a;
}

void uart_rx_event(emu_t *e)
{
	struct uart *u = &e->uart;
	uint8_t v = u->in[u->in_read++];
	bool fe = false;

	if (u->in_read < u->in_n) {
		u->in_end += 10 * u->host_bit;
		emu_at(e, EV_RX, (uint64_t)ceil(u->in_end));
	} else {
		u->in_read = u->in_n = 0;
		emu_at(e, EV_RX, NEVER);
	}
	if (!(e->avr->data[UCSRB] & RXEN))
		return;
	if (!matched(e)) {
		uint32_t r = noise_next(&u->noise);

		u->garbled++;
		v ^= (uint8_t)(r >> 7);
		fe = r & 1;
	}
	if (u->fifo_n == 2) {
		u->overrun++;
		e->avr->data[UCSRA] |= DOR;
		return;
	}
	u->received++;
	u->fifo[u->fifo_n] = v;
	u->fifo_fe[u->fifo_n++] = fe;
	show_head(e);
	if (!u->io->rxc.pending)
		avr_raise_interrupt(e->avr, &u->io->rxc);
}

static uint8_t udr_read(avr_t *avr, avr_io_addr_t addr, void *param)
{
	emu_t *e = param;
	struct uart *u = &e->uart;
	uint8_t v = u->fifo[0];

	(void)addr;
	if (!u->fifo_n)
		return v;
	u->fifo[0] = u->fifo[1];
	u->fifo_fe[0] = u->fifo_fe[1];
	u->fifo_n--;
	avr_clear_interrupt(avr, &u->io->rxc);
	avr->data[UCSRA] &= (uint8_t)~DOR;
	show_head(e);
	if (u->fifo_n)
		avr_raise_interrupt(avr, &u->io->rxc);
	return v;
}

int emu_uart_write(emu_t *e, const uint8_t *buf, int n)
{
	struct uart *u = &e->uart;

	if (n <= 0)
		return 0;
	if (u->in_n + (size_t)n > u->in_cap) {
		size_t cap = 2 * (u->in_n + (size_t)n);
		uint8_t *in = realloc(u->in, cap);

		if (!in)
			return 0;
		u->in = in;
		u->in_cap = cap;
	}
	memcpy(u->in + u->in_n, buf, (size_t)n);
	u->in_n += (size_t)n;
	if (e->when[EV_RX] == NEVER) {
		if (u->in_end < (double)e->now)
			u->in_end = (double)e->now;
		u->in_end += 10 * u->host_bit;
		emu_at(e, EV_RX, (uint64_t)ceil(u->in_end));
	}
	return n;
}

void emu_uart_baud(emu_t *e, double host_baud)
{
	e->uart.host_bit = e->hz / host_baud;
}

void emu_uart_stats(const emu_t *e, double out[5])
{
	out[0] = e->hz / mcu_bit(e);
	out[1] = (double)e->uart.received;
	out[2] = (double)e->uart.overrun;
	out[3] = (double)e->uart.garbled;
	out[4] = (double)e->uart.sent;
}

/* --- registers --------------------------------------------------------- */

static void ucsra_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	const uint8_t mine = U2X | MPCM;

	if (v & TXC)
		avr_clear_interrupt(avr, &e->uart.io->txc); /* and the flag */
	avr->data[addr] = (uint8_t)((avr->data[addr] & ~mine) | (v & mine));
}

/* The interrupts are levels: enabling one whose flag is set raises it. */
static void ucsrb_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	struct uart *u = &((emu_t *)param)->uart;
	avr_int_vector_t *all[] = {&u->io->rxc, &u->io->udrc, &u->io->txc};
	uint8_t old = avr->data[addr];

	avr->data[addr] = v;
	if (old & RXEN && !(v & RXEN)) {
		u->fifo_n = 0;
		avr_clear_interrupt(avr, &u->io->rxc);
		show_head(param);
	}
	for (int i = 0; i < 3; i++)
		if (!all[i]->pending && avr_regbit_get(avr, all[i]->enable) &&
		    avr_regbit_get(avr, all[i]->raised))
			avr_raise_interrupt(avr, all[i]);
}

static void own(emu_t *e, avr_io_addr_t reg, avr_io_read_t r, avr_io_write_t w)
{
	int i = AVR_DATA_TO_IO(reg);

	e->avr->io[i].r.c = r;
	e->avr->io[i].r.param = e;
	e->avr->io[i].w.c = w;
	e->avr->io[i].w.param = e;
}

int uart_init(emu_t *e)
{
	e->uart.io = emu_module(e, "uart", 0);
	if (!e->uart.io)
		return 0;
	own(e, UDR, udr_read, udr_write);
	own(e, UCSRA, NULL, ucsra_write);
	own(e, UCSRB, NULL, ucsrb_write);
	own(e, UCSRC, NULL, NULL);
	own(e, UBRRL, NULL, NULL);
	own(e, UBRRH, NULL, NULL);
	e->uart.noise = 0x9E3779B9u;
	emu_uart_baud(e, 500000);
	return 1;
}

/* A byte under way is cut off; what is on its way to the MCU still comes. */
void uart_after_reset(emu_t *e)
{
	struct uart *u = &e->uart;

	while (u->out_n > u->out_read && u->out_at[u->out_n - 1] > e->avr->cycle)
		u->out_n--;
	if (u->stop > e->avr->cycle)
		u->stop = NEVER;
	u->shifting = u->buffered = false;
	u->fifo_n = 0;
	e->avr->data[UCSRA] = UDRE;
	e->avr->data[UCSRC] = 0x06;
	emu_at(e, EV_TX, NEVER);
}

void uart_free(emu_t *e)
{
	free(e->uart.out);
	free(e->uart.out_at);
	free(e->uart.in);
}
