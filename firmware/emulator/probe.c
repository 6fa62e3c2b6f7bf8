/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Measuring: interrupt times, marks written to GPIOR0, stack, memory.
 */
#include <string.h>

#include "core.h"

#define GPIOR0 0x3E
#define PAINT 0xC5

void log_put(struct event_log *log, uint64_t cycle, int what, int value)
{
	uint32_t i = log->head++ % LOG_SIZE;

	log->cycle[i] = cycle;
	log->what[i] = (uint8_t)what;
	log->value[i] = (uint8_t)value;
	if (log->head - log->tail > LOG_SIZE)
		log->tail = log->head - LOG_SIZE; /* the oldest is lost */
}

int log_get(struct event_log *log, uint64_t *cycle, uint8_t *what,
	    uint8_t *value, int max)
{
	int n = 0;

	for (; n < max && log->tail != log->head; n++) {
		uint32_t i = log->tail++ % LOG_SIZE;

		cycle[n] = log->cycle[i];
		if (what)
			what[n] = log->what[i];
		value[n] = log->value[i];
	}
	return n;
}

static void isr_notify(struct avr_irq_t *irq, uint32_t running, void *param)
{
	struct isr_stat *s = param;
	uint64_t took;

	(void)irq;
	if (running) {
		s->start = s->e->avr->cycle;
		return;
	}
	took = s->e->avr->cycle + 4 - s->start; /* reti itself */
	s->count++;
	s->total += took;
	if (took > s->max)
		s->max = took;
	if (took < s->min)
		s->min = took;
}

void emu_isr(const emu_t *e, int v, uint64_t out[4])
{
	memset(out, 0, 4 * sizeof *out);
	if (v < 1 || v >= VECTORS)
		return;
	out[0] = e->isr[v].count;
	out[1] = e->isr[v].count ? e->isr[v].min : 0;
	out[2] = e->isr[v].max;
	out[3] = e->isr[v].total;
}

static void mark_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	avr->data[addr] = v;
	log_put(&((emu_t *)param)->marks, avr->cycle, 0, v);
}

int emu_mark(emu_t *e, uint64_t *cycle, uint8_t *value, int max)
{
	return log_get(&e->marks, cycle, NULL, value, max);
}

/* RAM was painted at power-on: the largest unpainted-free gap lies between
 * the static variables and the deepest reach of the stack. */
void emu_stack(const emu_t *e, uint32_t out[2])
{
	const uint8_t *data = e->avr->data;
	uint32_t end = e->avr->ramend, best = 0, best_end = end, run = 0;

	for (uint32_t a = e->avr->ioend + 1u; a <= end; a++) {
		run = data[a] == PAINT ? run + 1 : 0;
		if (run > best) {
			best = run;
			best_end = a;
		}
	}
	out[0] = best ? end - best_end : end - e->avr->ioend;
	out[1] = best;
}

int emu_peek(const emu_t *e, int address)
{
	if (address < 0 || address > e->avr->ramend)
		return -1;
	return e->avr->data[address];
}

void emu_poke(emu_t *e, int address, int value)
{
	if (address >= 0 && address <= e->avr->ramend)
		e->avr->data[address] = (uint8_t)value;
}

int probe_init(emu_t *e)
{
	for (int v = 1; v < VECTORS; v++) {
		avr_irq_t *irq = avr_get_interrupt_irq(e->avr, (uint8_t)v);

		e->isr[v].e = e;
		e->isr[v].min = UINT64_MAX;
		if (irq)
			avr_irq_register_notify(irq + AVR_INT_IRQ_RUNNING,
						isr_notify, &e->isr[v]);
	}
	avr_register_io_write(e->avr, GPIOR0, mark_write, e);
	return 1;
}
