/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * D9 (OC1A) and D10 (OC1B) as compare outputs of Timer1, modes without PWM.
 * After the data sheet, "Compare match output unit": COM1x != 0 takes the pin
 * from PORTB, DDRB still says whether it is driven; the OC1x register keeps
 * what the last match or force left, also while COM1x = 0; a reset clears it.
 *
 * simavr passes a match on to the port, where any later write to PORTB undoes
 * it, and takes writes to OCR1x for overflows.
 */
#include "core.h"

#define TCCR1A 0x80
#define TCCR1C 0x82
#define COM_TOGGLE 1
#define COM_SET 3

static int mode_of(const emu_t *e, int unit)
{
	return e->avr->data[TCCR1A] >> (unit ? 4 : 6) & 3;
}

/* What D9 and D10 carry when the port says port_level. */
static int level(const emu_t *e, int bit, int port_level)
{
	if ((bit != 1 && bit != 2) || !mode_of(e, bit - 1))
		return port_level;
	return e->timer1.latch[bit - 1];
}

static void show(emu_t *e)
{
	const avr_ioport_t *p = e->port[0];
	const uint8_t *d = e->avr->data;

	for (int bit = 1; bit <= 2; bit++)
		pins_show(e, 0, bit, d[p->r_ddr], d[p->r_port] >> bit & 1);
}

static void match(emu_t *e, int unit)
{
	int mode = mode_of(e, unit);
	uint8_t *latch = &e->timer1.latch[unit];

	if (mode == COM_TOGGLE)
		*latch ^= 1;
	else if (mode)
		*latch = mode == COM_SET;
	show(e);
}

/* simavr also comes here with the opposite level, where PWM would set it. */
static void notify(struct avr_irq_t *irq, uint32_t value, void *param)
{
	emu_t *e = param;
	int unit = irq != e->timer1.io->io.irq + TIMER_IRQ_OUT_COMP;
	int mode = mode_of(e, unit);

	if (mode == COM_TOGGLE || (value & 1) == (mode == COM_SET))
		match(e, unit);
}

static void tccr1a_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;

	e->timer1.write(avr, addr, v, e->timer1.param);
	show(e);
}

static void tccr1c_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	avr->data[addr] = 0; /* FOC1A and FOC1B read 0 */
	if (v & 0x80)
		match(param, 0);
	if (v & 0x40)
		match(param, 1);
}

void compare_after_reset(emu_t *e)
{
	avr_irq_t *irq = e->timer1.io->io.irq + TIMER_IRQ_OUT_COMP;

	e->timer1.latch[0] = e->timer1.latch[1] = 0;
	for (int unit = 0; unit < 2; unit++) /* simavr has connected them */
		avr_unconnect_irq(irq + unit, e->port[0]->io.irq + 1 + unit);
}

int compare_init(emu_t *e)
{
	int i = AVR_DATA_TO_IO(TCCR1A);
	avr_timer_t *t = NULL;

	for (int nth = 0; (t = emu_module(e, "timer", nth)); nth++)
		if (t->name == '1')
			break;
	if (!t)
		return 0;
	e->timer1.io = t;
	e->timer1.write = e->avr->io[i].w.c;
	e->timer1.param = e->avr->io[i].w.param;
	e->avr->io[i].w.c = tccr1a_write;
	e->avr->io[i].w.param = e;
	avr_register_io_write(e->avr, TCCR1C, tccr1c_write, e);
	e->drives_b = level;
	for (int unit = 0; unit < 2; unit++)
		avr_irq_register_notify(t->io.irq + TIMER_IRQ_OUT_COMP + unit,
					notify, e);
	return 1;
}
