/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Watchdog timer, in place of simavr's, after the data sheet of the
 * ATmega328P, chapter "System control and reset":
 *
 *   WDE WDIE  at a time-out
 *    1   0    system reset
 *    0   1    interrupt, again and again; never a reset
 *    1   1    interrupt, and its vector clears WDIE; "if the interrupt is
 *             not executed before the next time-out, a System Reset will be
 *             applied", so interrupts that are off cost one period more
 *
 * simavr clears WDIE also with WDE = 0 and never resets while WDIE is set.
 */
#include "core.h"

#define MCUSR 0x54
#define WDRF 0x08
#define WDTCSR 0x60
#define WDE 0x08
#define WDCE 0x10
#define WDIE 0x40
#define WDIF 0x80
#define WDP 0x27
#define VECTOR 6
#define KEY_CYCLES 4

/* 2048 ... 1048576 cycles of 128 kHz, each 125 of ours. */
static uint64_t period(uint8_t wdtcsr)
{
	int wdp = (wdtcsr & 7) | (wdtcsr >> 2 & 8);

	return (uint64_t)(2048 * 125) << (wdp > 9 ? 9 : wdp);
}

static void schedule(emu_t *e)
{
	uint8_t v = e->avr->data[WDTCSR];

	emu_at(e, EV_WATCHDOG, v & (WDE | WDIE) ?
			       e->watchdog.since + period(v) : NEVER);
}

void watchdog_event(emu_t *e)
{
	uint8_t v = e->avr->data[WDTCSR];

	e->watchdog.since = e->when[EV_WATCHDOG];
	if (v & WDE && (!(v & WDIE) || v & WDIF)) {
		e->watchdog.bitten = true;
		emu_at(e, EV_WATCHDOG, NEVER);
		return;
	}
	avr_raise_interrupt(e->avr, &e->watchdog.io->watchdog);
	schedule(e);
}

/* Before simavr's own handling, which would clear WDIE in either mode. */
static void entered(struct avr_irq_t *irq, uint32_t running, void *param)
{
	emu_t *e = param;
	uint8_t *v = &e->avr->data[WDTCSR];

	(void)irq;
	if (!running)
		return;
	*v &= (uint8_t)(*v & WDE ? ~(WDIF | WDIE) : ~WDIF);
	schedule(e);
}

static uint8_t written(const emu_t *e, uint8_t old, uint8_t v)
{
	uint8_t wdrf = e->avr->data[MCUSR] & WDRF ? WDE : 0;
	bool open = e->avr->cycle <= e->watchdog.open_until;
	uint8_t kept = old & (WDP | WDE);

	if (open && !(v & WDCE))
		kept = (v & (WDP | WDE)) | wdrf;
	return (uint8_t)(kept | (v & (WDE | WDIE)) | (old & WDIF & ~v));
}

static void wdtcsr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	avr_int_vector_t *vector = &e->watchdog.io->watchdog;
	uint8_t old = avr->data[addr], now = written(e, old, v);

	e->watchdog.open_until = (v & (WDCE | WDE)) == (WDCE | WDE) ?
				 avr->cycle + KEY_CYCLES : 0;
	avr->data[addr] = now & (uint8_t)~WDIF;
	if (!(now & WDIF) && vector->pending)
		avr_clear_interrupt(avr, vector);
	else if (now & WDIF && now & WDIE && !vector->pending)
		avr_raise_interrupt(avr, vector);
	avr->data[addr] = now;
	if (!(old & (WDE | WDIE)))
		e->watchdog.since = avr->cycle;
	schedule(e);
}

/* The instruction WDR. */
static int watchdog_ioctl(struct avr_io_t *io, uint32_t ctl, void *param)
{
	emu_t *e = io->avr->custom.data;

	(void)param;
	if (ctl != AVR_IOCTL_WATCHDOG_RESET)
		return -1;
	e->watchdog.since = e->avr->cycle;
	schedule(e);
	return 0;
}

void watchdog_after_reset(emu_t *e)
{
	const uint8_t *d = e->avr->data;

	e->watchdog.bitten = false;
	e->watchdog.since = e->avr->cycle +
			    (uint64_t)(e->boot.startup * e->hz);
	e->watchdog.open_until = 0;
	e->avr->data[WDTCSR] = d[MCUSR] & WDRF ? WDE : 0; /* 16 ms */
	schedule(e);
}

int watchdog_init(emu_t *e)
{
	int i = AVR_DATA_TO_IO(WDTCSR);
	avr_irq_t *irq = avr_get_interrupt_irq(e->avr, VECTOR);

	e->watchdog.io = emu_module(e, "watchdog", 0);
	if (!e->watchdog.io || !irq ||
	    e->avr->io[i].w.param != e->watchdog.io)
		return 0;
	e->avr->custom.data = e;
	e->watchdog.io->io.ioctl = watchdog_ioctl;
	e->avr->io[i].w.c = wdtcsr_write;
	e->avr->io[i].w.param = e;
	avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING, entered, e);
	return 1;
}
