/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * What hangs on A0: a voltage behind a resistance, or nothing. The pull-up of
 * the pin acts on both; simavr's ADC knows none.
 */
#include <simavr/avr_adc.h>

#include "core.h"

#define PULL_UP 35e3 /* ohm, data sheet: 20 to 50 k */

static void sample(struct avr_irq_t *irq, uint32_t value, void *param)
{
	emu_t *e = param;
	const uint8_t *data = e->avr->data;
	const avr_ioport_t *c = e->port[1];
	double supply = e->avr->avcc, mv = e->divider.mv;
	bool pulled = !(data[c->r_ddr] & 1) && data[c->r_port] & 1;

	(void)irq;
	(void)value;
	if (e->divider.ohm < 0) /* open: wherever its charge lies */
		mv = pulled ? supply :
			      supply * (noise_next(&e->divider.noise) >> 16) /
				      65536.0;
	else if (pulled)
		mv = (mv * PULL_UP + supply * e->divider.ohm) /
		     (PULL_UP + e->divider.ohm);
	avr_raise_irq(e->divider.input, mv > 0 ? (uint32_t)(mv + 0.5) : 0);
}

int divider_init(emu_t *e)
{
	avr_irq_t *trigger = avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ,
					   ADC_IRQ_OUT_TRIGGER);

	e->divider.input = avr_io_getirq(e->avr, AVR_IOCTL_ADC_GETIRQ,
					 ADC_IRQ_ADC0);
	if (!trigger || !e->divider.input)
		return 0;
	e->divider.ohm = -1;
	e->divider.noise = 1;
	avr_irq_register_notify(trigger, sample, e);
	return 1;
}

void emu_divider(emu_t *e, double volt, double ohm)
{
	e->divider.mv = 1000 * volt;
	e->divider.ohm = ohm;
}
