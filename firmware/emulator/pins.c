/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Port pins: inputs from the world, a log of what the MCU drives, and who is
 * told of it. The parts that hang on a pin enter themselves in emu.hangs (D4
 * powers the BNO055, D7 the IR sensor, PC4/PC5 are the bus lines while the TWI
 * is off); Timer1, which may drive D9 and D10, in emu.drives_b.
 */
#include <simavr/avr_extint.h>

#include "core.h"

static void capture_show(emu_t *e)
{
	int gate = e->capture.gate;
	bool through = !gate || e->state[2][gate] == PIN_HIGH;

	pins_input(e, 0, 0, e->capture.level && through);
}

static void changed(emu_t *e, int port, int bit, int state)
{
	if (e->state[port][bit] == state)
		return;
	e->state[port][bit] = (uint8_t)state;
	log_put(&e->pins, e->avr->cycle, port << 4 | bit, state);
	if (e->hangs[port][bit])
		e->hangs[port][bit](e, state);
	if (port == 2 && bit && bit == e->capture.gate)
		capture_show(e);
}

/* The pin as DDR, PORT and, on port B, Timer1 have it. */
void pins_show(emu_t *e, int port, int bit, uint8_t ddr, int port_level)
{
	int level = port == 0 && e->drives_b ?
		    e->drives_b(e, bit, port_level) : port_level;

	changed(e, port, bit, !(ddr >> bit & 1) ? PIN_RELEASED :
			      level ? PIN_HIGH : PIN_LOW);
}

/* irq->irq is the number of the pin, or IOPORT_IRQ_DIRECTION_ALL, which comes
 * with the new DDR before that is in the register. */
static void pin_notify(struct avr_irq_t *irq, uint32_t value, void *param)
{
	emu_t *e = param;
	const uint8_t *data = e->avr->data;
	int bit = (int)irq->irq, port = 0;
	avr_ioport_t *p;

	while (irq < e->port[port]->io.irq ||
	       irq >= e->port[port]->io.irq + IOPORT_IRQ_COUNT)
		if (++port == 3)
			return;
	p = e->port[port];
	if (bit < 8) {
		pins_show(e, port, bit, data[p->r_ddr], value & 1);
		return;
	}
	for (bit = 0; bit < 8; bit++)
		pins_show(e, port, bit, (uint8_t)value,
			  data[p->r_port] >> bit & 1);
}

/* The level of an undriven pin, against the pull-up as well. */
void pins_input(emu_t *e, int port, int bit, int level)
{
	avr_ioport_t *p = e->port[port];
	uint8_t mask = (uint8_t)(1 << bit);

	p->external.pull_mask |= mask;
	if (level)
		p->external.pull_value |= mask;
	else
		p->external.pull_value &= (uint8_t)~mask;
	if (!(e->avr->data[p->r_ddr] & mask))
		avr_raise_irq(p->io.irq + bit, (uint32_t)level);
}

int pins_init(emu_t *e)
{
	for (int i = 0; i < 3; i++) {
		avr_ioport_t *p = NULL;

		for (int nth = 0; (p = emu_module(e, "port", nth)); nth++)
			if (p->name == 'B' + i)
				break;
		if (!p)
			return 0;
		e->port[i] = p;
		for (int bit = 0; bit < 8; bit++) {
			e->state[i][bit] = PIN_RELEASED;
			avr_irq_register_notify(p->io.irq + bit, pin_notify, e);
		}
		avr_irq_register_notify(p->io.irq + IOPORT_IRQ_DIRECTION_ALL,
					pin_notify, e);
	}
	return 1;
}

void pins_after_reset(emu_t *e)
{
	/* with ISC = 00 and a low pin simavr would poll for ever */
	avr_extint_set_strict_lvl_trig(e->avr, 0, 0);
	avr_extint_set_strict_lvl_trig(e->avr, 1, 0);
	for (int port = 0; port < 3; port++)
		for (int bit = 0; bit < 8; bit++)
			changed(e, port, bit, PIN_RELEASED);
}

/* When the parts have put their levels on the released pins. */
void pins_settle(emu_t *e)
{
	for (int port = 0; port < 3; port++) {
		avr_ioport_t *p = e->port[port];
		uint8_t level = p->external.pull_mask & p->external.pull_value;

		e->avr->data[p->r_pin] = level;
		/* simavr passes only changes on: what it remembers of before
		 * the reset would hide the first write after it */
		for (int bit = 0; bit < 8; bit++)
			p->io.irq[bit].value = level >> bit & 1;
		p->io.irq[IOPORT_IRQ_DIRECTION_ALL].value = 0;
	}
}

void emu_pin(emu_t *e, int port, int bit, int level)
{
	if (port == 'B' && bit == 0) {
		e->capture.level = level != 0;
		capture_show(e);
	} else if (port >= 'B' && port <= 'D' && bit >= 0 && bit < 8) {
		pins_input(e, port - 'B', bit, level != 0);
	}
}

void emu_capture(emu_t *e, int gate)
{
	e->capture.gate = gate == 5 || gate == 6 ? gate : 0;
	capture_show(e);
}

int emu_pin_state(const emu_t *e, int port, int bit)
{
	if (port < 'B' || port > 'D' || bit < 0 || bit > 7)
		return PIN_RELEASED;
	return e->state[port - 'B'][bit];
}

int emu_pin_log(emu_t *e, uint64_t *cycle, uint8_t *pin, uint8_t *state,
		int max)
{
	return log_get(&e->pins, cycle, pin, state, max);
}
