/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Resets, what comes between a reset and the program, supply, standing still.
 */
#include <string.h>

#include "core.h"

#define MCUSR 0x54
#define PAINT 0xC5
#define BOD_MV 2700      /* extended fuse FD, typical */
#define BOD_RELEASE 2750 /* hysteresis 50 mV */

/* The start-up time of the fuses, then a bootloader that touches no pin of
 * ours: the program is held back and nothing is driven. Without supply, for
 * ever. */
static void hold(emu_t *e, int cause)
{
	double wait = e->boot.startup + (cause == EMU_EXTERNAL ?
					 e->boot.external : e->boot.other);
	bool dead = e->unpowered || e->low_supply;

	e->held = dead || wait > 0;
	emu_at(e, EV_BOOT, e->held && !dead ?
			   e->avr->cycle + (uint64_t)(wait * e->hz) : NEVER);
}

void reset_event(emu_t *e)
{
	e->held = false;
	emu_at(e, EV_BOOT, NEVER);
}

void emu_reset(emu_t *e, int cause)
{
	static const uint8_t flag[] = {1 << 1, 1 << 0, 1 << 2, 1 << 3};
	uint8_t old = cause == EMU_POWER ? 0 : e->avr->data[MCUSR];

	if (cause == EMU_POWER || cause == EMU_BROWNOUT)
		eeprom_supply_lost(e);
	if (cause == EMU_POWER)
		memset(e->avr->data + e->avr->ioend + 1, PAINT,
		       e->avr->ramend - e->avr->ioend);
	avr_reset(e->avr);
	e->hang = e->frozen = false;
	e->gate = NEVER; /* avr_reset dropped all timers */
	e->avr->data[MCUSR] = e->boot.clears ?
			      0 : (uint8_t)(old | flag[cause & 3]);
	watchdog_after_reset(e);
	uart_after_reset(e);
	twi_after_reset(e);
	pins_after_reset(e);
	compare_after_reset(e);
	wheel_after_reset(e);
	pins_settle(e);
	hold(e, cause);
	emu_gate(e);
}

void emu_boot(emu_t *e, const double in[4])
{
	e->boot.startup = in[0];
	e->boot.external = in[1];
	e->boot.other = in[2];
	e->boot.clears = in[3] != 0;
}

void emu_power(emu_t *e, int on)
{
	if (e->unpowered == !on)
		return;
	e->unpowered = !on;
	emu_reset(e, EMU_POWER);
}

void emu_vcc(emu_t *e, int millivolt)
{
	bool was_low = e->low_supply;

	e->avr->vcc = e->avr->avcc = e->avr->aref = (uint32_t)millivolt;
	e->low_supply = millivolt < (was_low ? BOD_RELEASE : BOD_MV);
	if (e->low_supply && !was_low)
		emu_reset(e, EMU_BROWNOUT);
	else if (was_low && !e->low_supply)
		hold(e, EMU_BROWNOUT);
}

/* --- standing still ---------------------------------------------------- */

void emu_hang(emu_t *e, int on)
{
	e->hang = on;
}

/* As `cli` and a jump to itself: timers, their pins and the watchdog go on. */
void emu_freeze(emu_t *e, int on)
{
	avr_t *avr = e->avr;

	if (e->frozen == on)
		return;
	e->frozen = on;
	if (on) {
		e->frozen_i = avr->sreg[S_I];
		avr->sreg[S_I] = 0;
	} else {
		avr->sreg[S_I] = e->frozen_i;
		if (e->frozen_i && avr_has_pending_interrupts(avr))
			avr->interrupt_state = 1;
	}
}
