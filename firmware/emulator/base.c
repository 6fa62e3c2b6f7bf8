/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * What every part stands on: time, the event that comes next, the modules of
 * simavr, noise. It knows none of the parts.
 */
#include <math.h>
#include <string.h>

#include "core.h"

/* --- time ---------------------------------------------------------------- */

double emu_world(const emu_t *e, uint64_t cycle)
{
	return e->world_t + ((double)cycle - (double)e->world_c) / e->hz;
}

uint64_t emu_cycle(const emu_t *e, double world)
{
	double c = (double)e->world_c + (world - e->world_t) * e->hz;

	if (!(c < 1e15))
		return NEVER;
	return c > 0 ? (uint64_t)ceil(c) : 0;
}

/* --- events -------------------------------------------------------------- */

static avr_cycle_count_t gate_passed(avr_t *avr, avr_cycle_count_t when,
				     void *param)
{
	(void)avr;
	(void)when;
	((emu_t *)param)->gate = NEVER;
	return 0;
}

/* A timer of simavr at the next cycle that concerns us: simavr then ends its
 * run of instructions there, also when a register write adds a timer. It
 * changes nothing that the program could see. */
void emu_gate(emu_t *e)
{
	uint64_t when = e->next_event < e->limit ? e->next_event : e->limit;
	uint64_t now = e->avr->cycle;

	if (when == e->gate)
		return;
	e->gate = when;
	if (when == NEVER)
		avr_cycle_timer_cancel(e->avr, gate_passed, e);
	else
		avr_cycle_timer_register(e->avr, when > now ? when - now : 0,
					 gate_passed, e);
}

static void find_next(emu_t *e)
{
	uint64_t next = NEVER;

	for (int i = 0; i < EV_COUNT; i++)
		if (e->when[i] < next)
			next = e->when[i];
	e->next_event = next;
}

void emu_at(emu_t *e, int event, uint64_t when)
{
	e->when[event] = when;
	find_next(e);
	emu_gate(e);
}

/* --- simavr, noise -------------------------------------------------------- */

void *emu_module(emu_t *e, const char *kind, int nth)
{
	for (avr_io_t *io = e->avr->io_port; io; io = io->next)
		if (io->kind && !strcmp(io->kind, kind) && nth-- == 0)
			return io;
	return NULL;
}

uint32_t noise_next(uint32_t *state)
{
	uint32_t x = *state;

	x ^= x << 13;
	x ^= x >> 17;
	x ^= x << 5;
	return *state = x;
}
