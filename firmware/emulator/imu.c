/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * The BNO055 on its supply pin, its samples, and the caller's side of it.
 */
#include <string.h>

#include "core.h"

void imu_event(emu_t *e)
{
	/* a restart of the part may have put it off */
	if (emu_cycle(e, e->imu.next) <= e->avr->cycle)
		bno_sample(&e->imu, e->imu.next);
	emu_at(e, EV_IMU, emu_cycle(e, e->imu.next));
}

/* D4 is its supply. */
static void supply(emu_t *e, int state)
{
	bno_power(&e->imu, state == PIN_HIGH, emu_world(e, e->avr->cycle));
	emu_at(e, EV_IMU, emu_cycle(e, e->imu.next));
}

int imu_init(emu_t *e)
{
	bno_init(&e->imu);
	e->hangs[2][4] = supply;
	return 1;
}

void emu_imu(emu_t *e, const double gyro[3], const double lin[3])
{
	bno_input(&e->imu, gyro, lin, emu_world(e, e->now));
}

void emu_imu_fault(emu_t *e, int fault, double value)
{
	e->imu.fault = fault;
	e->imu.fault_value = value;
	e->imu.updated = e->imu.next;
}

void emu_imu_config(emu_t *e)
{
	bno_config(&e->imu);
}

void emu_imu_reset(emu_t *e)
{
	bno_restart(&e->imu, emu_world(e, e->now));
	emu_at(e, EV_IMU, emu_cycle(e, e->imu.next));
}

void emu_imu_setup(emu_t *e, const double in[10])
{
	memcpy(e->imu.zero, in, 6 * sizeof *in);
	e->imu.period = 0.01 / (1 + in[6]);
	memcpy(e->imu.calib_after, in + 7, 3 * sizeof *in);
}

int emu_imu_peek(emu_t *e, int reg)
{
	return reg < 0 || reg > 127 ? -1 : e->imu.reg[reg];
}
