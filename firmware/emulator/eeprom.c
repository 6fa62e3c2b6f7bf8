/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * EEPROM: contents for the caller, and the 3.4 ms of a write, during which
 * EEPE stays set (simavr clears it at once).
 */
#include <string.h>

#include "core.h"

#define EECR 0x3F
#define EEPE 0x02
#define EEMPE 0x04
#define WRITE_CYCLES 54400 /* 3.4 ms of 16 MHz */

static void eecr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	uint8_t old = avr->data[addr], busy = old & EEPE;

	if (busy)
		v &= (uint8_t)~EEPE;
	e->eeprom.write(avr, addr, v, e->eeprom.io);
	if (v & EEPE && old & EEMPE) {
		busy = EEPE;
		emu_at(e, EV_EEPROM, avr->cycle + WRITE_CYCLES);
	}
	avr->data[addr] = (uint8_t)((avr->data[addr] & ~EEPE) | busy);
}

void eeprom_event(emu_t *e)
{
	e->avr->data[EECR] &= (uint8_t)~EEPE;
	emu_at(e, EV_EEPROM, NEVER);
}

int eeprom_init(emu_t *e)
{
	int i = AVR_DATA_TO_IO(EECR);

	e->eeprom.io = emu_module(e, "eeprom", 0);
	e->eeprom.write = e->avr->io[i].w.c;
	if (!e->eeprom.io || e->avr->io[i].w.param != e->eeprom.io)
		return 0;
	e->avr->io[i].w.c = eecr_write;
	e->avr->io[i].w.param = e;
	return 1;
}

int emu_eeprom_get(emu_t *e, uint8_t *buf, int n)
{
	if (n < 0 || n > e->eeprom.io->size)
		return -1;
	memcpy(buf, e->eeprom.io->eeprom, (size_t)n);
	return n;
}

int emu_eeprom_set(emu_t *e, const uint8_t *buf, int n)
{
	if (n < 0 || n > e->eeprom.io->size)
		return -1;
	memcpy(e->eeprom.io->eeprom, buf, (size_t)n);
	return n;
}
