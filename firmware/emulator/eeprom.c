/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * EEPROM: contents for the caller, and the 3.4 ms of a write, during which
 * EEPE stays set (simavr clears it at once). The data sheet: a reset does not
 * stop a write while the supply holds; without supply the byte is garbled.
 */
#include <string.h>

#include "core.h"

#define EECR 0x3F
#define EEARL 0x41
#define EEARH 0x42
#define EEPE 0x02
#define EEMPE 0x04
#define WRITE_CYCLES 54400 /* 3.4 ms of 16 MHz */

static void begin(emu_t *e)
{
	const uint8_t *d = e->avr->data;

	e->eeprom.done = e->avr->cycle + WRITE_CYCLES;
	e->eeprom.address = (uint16_t)(d[EEARL] | d[EEARH] << 8) % 1024;
	e->eeprom.cut = e->eeprom.tear && --e->eeprom.tear == 0;
	emu_at(e, EV_EEPROM, e->eeprom.done -
			     (e->eeprom.cut ? WRITE_CYCLES / 2 : 0));
}

/* Erased and written in part: any bits, but not the ones that were meant. */
void eeprom_supply_lost(emu_t *e)
{
	uint8_t *byte = e->eeprom.io->eeprom + e->eeprom.address;
	uint8_t meant = *byte;

	if (e->avr->cycle >= e->eeprom.done)
		return;
	e->eeprom.done = 0;
	do
		*byte = (uint8_t)(noise_next(&e->eeprom.noise) >> 8);
	while (*byte == meant);
}

static void eecr_write(avr_t *avr, avr_io_addr_t addr, uint8_t v, void *param)
{
	emu_t *e = param;
	uint8_t old = avr->data[addr], busy = old & EEPE;

	if (busy)
		v &= (uint8_t)~EEPE;
	e->eeprom.write(avr, addr, v, e->eeprom.io);
	if (v & EEPE && old & EEMPE) {
		busy = EEPE;
		begin(e);
	}
	avr->data[addr] = (uint8_t)((avr->data[addr] & ~EEPE) | busy);
}

void eeprom_event(emu_t *e)
{
	emu_at(e, EV_EEPROM, NEVER);
	if (e->eeprom.cut) {
		e->eeprom.cut = false;
		e->torn = true;
		return;
	}
	e->avr->data[EECR] &= (uint8_t)~EEPE;
}

void emu_eeprom_tear(emu_t *e, int nth)
{
	e->eeprom.tear = nth > 0 ? nth : 0;
}

int eeprom_init(emu_t *e)
{
	int i = AVR_DATA_TO_IO(EECR);

	e->eeprom.io = emu_module(e, "eeprom", 0);
	e->eeprom.noise = 0x7EA25EED;
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
