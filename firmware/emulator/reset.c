/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Resets, what comes between a reset and the program, and standing still.
 */
#include <string.h>

#include "core.h"

#define MCUSR 0x54
#define PAINT 0xC5

static void after_reset(emu_t *e, uint8_t mcusr)
{
	e->gate = NEVER; /* avr_reset dropped all timers */
	e->avr->data[MCUSR] = mcusr;
	uart_after_reset(e);
	twi_after_reset(e);
	pins_after_reset(e);
	emu_gate(e);
}

/* The start-up time of the fuses, then a bootloader that touches no pin of
 * ours: the program is held back and nothing is driven. */
static void hold(emu_t *e, int cause)
{
	double wait = e->boot.startup + (cause == EMU_EXTERNAL ?
					 e->boot.external : e->boot.other);

	e->held = wait > 0;
	emu_at(e, EV_BOOT, e->held ? e->avr->cycle + (uint64_t)(wait * e->hz)
				   : NEVER);
}

void reset_event(emu_t *e)
{
	e->held = false;
	emu_at(e, EV_BOOT, NEVER);
}

static uint8_t flags_of(const emu_t *e, uint8_t old, int cause)
{
	static const uint8_t flag[] = {1 << 1, 1 << 0, 1 << 2, 1 << 3};

	return e->boot.clears ? 0 : (uint8_t)(old | flag[cause & 3]);
}

/* The watchdog asks for a reset by replacing avr->run. */
void reset_watchdog(emu_t *e)
{
	uint8_t old = e->avr->data[MCUSR];

	if (e->boot.clears) /* and stops the watchdog */
		e->watchdog->reset_context.wdrf = 0;
	e->avr->run(e->avr);
	e->avr->run = e->raw_run;
	e->hang = e->frozen = false;
	after_reset(e, flags_of(e, old, EMU_WATCHDOG));
	hold(e, EMU_WATCHDOG);
}

void emu_reset(emu_t *e, int cause)
{
	uint8_t old = cause == EMU_POWER ? 0 : e->avr->data[MCUSR];

	e->avr->run = e->raw_run;
	e->watchdog->reset_context.wdrf =
		cause == EMU_WATCHDOG && !e->boot.clears;
	e->watchdog->reset_context.avr_run = e->raw_run;
	if (cause == EMU_POWER)
		memset(e->avr->data + e->avr->ioend + 1, PAINT,
		       e->avr->ramend - e->avr->ioend);
	avr_reset(e->avr);
	e->avr->run = e->raw_run;
	e->hang = e->frozen = false;
	after_reset(e, flags_of(e, old, cause));
	hold(e, cause);
}

void emu_boot(emu_t *e, const double in[4])
{
	e->boot.startup = in[0];
	e->boot.external = in[1];
	e->boot.other = in[2];
	e->boot.clears = in[3] != 0;
}

void emu_hang(emu_t *e, int on)
{
	e->hang = on;
}

void emu_vcc(emu_t *e, int millivolt)
{
	e->avr->vcc = e->avr->avcc = e->avr->aref = (uint32_t)millivolt;
}
