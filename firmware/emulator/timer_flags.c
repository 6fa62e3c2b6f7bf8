/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * The interrupt flags of Timer1 (TIFR1), after the data sheet: "can be cleared
 * by writing a logic one to its bit location"; the others stay.
 *
 * simavr clears every pending flag at any write: an overflow that came while
 * an edge was captured was lost, and the clock fell back by 32.8 ms.
 */
#include "core.h"

#define TIFR1 0x36

static void tifr1_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	avr_timer_t *t = param;
	avr_int_vector_t *all[] = { &t->overflow, &t->icr,
				    &t->comp[0].interrupt,
				    &t->comp[1].interrupt };

	(void)addr;
	for (unsigned i = 0; i < sizeof all / sizeof *all; i++)
		if (v >> all[i]->raised.bit & 1)
			avr_clear_interrupt(avr, all[i]);
}

int timer_flags_init(emu_t *e)
{
	int i = AVR_DATA_TO_IO(TIFR1);

	if (e->timer1.io->overflow.raised.reg != TIFR1)
		return 0;
	e->avr->io[i].w.c = tifr1_write;
	e->avr->io[i].w.param = e->timer1.io;
	return 1;
}
