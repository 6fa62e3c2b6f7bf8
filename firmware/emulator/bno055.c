/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "bno055.h"

#include <math.h>
#include <string.h>

#include "core.h"

#define GRAVITY 9.80665
#define CLOCK_ERROR 0.0037 /* its own oscillator: never in step with the Nano */

enum {
	CHIP_ID = 0x00, PAGE_ID = 0x07, ACC = 0x08, GYR = 0x14, QUA = 0x20,
	LIA = 0x28, GRV = 0x2E, TEMP = 0x34, CALIB_STAT = 0x35,
	ST_RESULT = 0x36, SYS_STATUS = 0x39, UNIT_SEL = 0x3B, OPR_MODE = 0x3D,
	PWR_MODE = 0x3E, SYS_TRIGGER = 0x3F, AXIS_MAP = 0x41, OFFSETS = 0x55,
	OFFSETS_END = 0x6A, FIRST_WRITABLE = 0x3B
};

static bool fusion(uint8_t mode)
{
	return mode >= 0x08 && mode <= 0x0C;
}

static bool has_acc(uint8_t mode)
{
	return mode == 1 || mode == 4 || mode == 5 || mode == 7 || fusion(mode);
}

static bool has_gyro(uint8_t mode)
{
	return mode == 3 || (mode >= 5 && mode <= 8) || mode == 0x0B ||
	       mode == 0x0C;
}

static void defaults(struct bno055 *b)
{
	static const uint8_t id[] = {0xA0, 0xFB, 0x32, 0x0F, 0x11, 0x03, 0x15};

	memset(b->reg, 0, sizeof b->reg);
	memcpy(b->reg, id, sizeof id);
	b->reg[ST_RESULT] = 0x0F;
	b->reg[UNIT_SEL] = 0x80;
	b->reg[AXIS_MAP] = 0x24;
	b->reg[0x40] = 0x02;
	memset(b->offset, 0, sizeof b->offset);
	b->page = b->pointer = 0;
	b->mode = b->wanted = 0;
	b->fused = 0;
	b->restored = false;
}

void bno_init(struct bno055 *b)
{
	static const double calib[] = {2.0, 1.0, 4.0};

	memset(b, 0, sizeof *b);
	memcpy(b->calib_after, calib, sizeof calib);
	b->period = 0.01 / (1 + CLOCK_ERROR);
	b->ready = b->next = INFINITY;
	b->noise = 0x1234567u;
	defaults(b);
}

static void start(struct bno055 *b, double ready)
{
	defaults(b);
	b->ready = ready;
	b->next = ready; /* its clock starts here, whatever the Nano's does */
}

void bno_power(struct bno055 *b, bool on, double t)
{
	if (on == b->powered)
		return;
	b->powered = on;
	if (on) {
		start(b, t + 0.400);
		return;
	}
	defaults(b);
	b->ready = b->next = INFINITY;
}

void bno_restart(struct bno055 *b, double t)
{
	if (b->powered)
		start(b, t + 0.650);
}

/* A dip of its supply that its reset does not see whole. */
void bno_config(struct bno055 *b)
{
	if (b->powered)
		defaults(b);
}

/* --- signals ----------------------------------------------------------- */

/* First-order low-pass over the constant input since the last call. */
static void filter_to(struct bno055 *b, double t)
{
	static const double hz[] = {32, 62.5}; /* gyro, accelerometer */
	double dt = t - b->filter_t;

	if (dt <= 0)
		return;
	for (int i = 0; i < 6; i++) {
		double keep = exp(-2 * M_PI * hz[i / 3] * dt);

		b->filtered[i] = b->in[i] + (b->filtered[i] - b->in[i]) * keep;
	}
	b->filter_t = t;
}

void bno_input(struct bno055 *b, const double gyro[3], const double lin[3],
	       double t)
{
	if (!memcmp(b->in, gyro, 3 * sizeof *gyro) &&
	    !memcmp(b->in + 3, lin, 3 * sizeof *lin))
		return;
	filter_to(b, t);
	memcpy(b->in, gyro, 3 * sizeof *gyro);
	memcpy(b->in + 3, lin, 3 * sizeof *lin);
}

static void put(struct bno055 *b, int reg, double v)
{
	long n = v > 32767 ? 32767 : v < -32768 ? -32768 : lround(v);

	b->reg[reg] = (uint8_t)n;
	b->reg[reg + 1] = (uint8_t)(n >> 8);
}

static double clip(double v, double limit)
{
	return v > limit ? limit : v < -limit ? -limit : v;
}

/* The newest data go in, those of `fault_value` seconds ago come out. */
static void put_late(struct bno055 *b)
{
	unsigned behind = (unsigned)lround(b->fault_value / b->period);
	unsigned n = b->late_n++;

	memcpy(b->late[n % BNO_LATE], b->reg + ACC, BNO_DATA);
	if (behind > n)
		behind = n;
	if (behind >= BNO_LATE)
		behind = BNO_LATE - 1;
	memcpy(b->reg + ACC, b->late[(n - behind) % BNO_LATE], BNO_DATA);
}

static void put_data(struct bno055 *b)
{
	double gain = b->fault == EMU_IMU_WRONG ? b->fault_value : 1;
	uint8_t unit = b->reg[UNIT_SEL];
	double per_acc = unit & 1 ? 1000 / GRAVITY : 100;
	double per_gyro = unit & 2 ? 900 : 16 * 180 / M_PI;

	for (int i = 0; i < 3; i++) {
		double down = i == 2 ? GRAVITY : 0;
		double lin = b->filtered[3 + i] + b->zero[3 + i] -
			     b->offset[i] * 0.01;
		double acc = clip(gain * lin + down, 4 * GRAVITY);
		double gyro = b->filtered[i] + b->zero[i] -
			      b->offset[6 + i] / 16.0 * M_PI / 180;

		if (has_acc(b->mode))
			put(b, ACC + 2 * i, acc * per_acc);
		if (has_gyro(b->mode))
			put(b, GYR + 2 * i,
			    clip(gain * gyro, 2000 * M_PI / 180) * per_gyro);
		if (!fusion(b->mode))
			continue;
		put(b, LIA + 2 * i, (acc - down) * per_acc);
		put(b, GRV + 2 * i, down * per_acc);
	}
	if (fusion(b->mode))
		put(b, QUA, 16384);
	b->reg[TEMP] = 25;
}

static void put_garbage(struct bno055 *b)
{
	for (int i = ACC; i < TEMP; i++) {
		b->reg[i] = (uint8_t)(noise_next(&b->noise) >> 9);
	}
}

static void update(struct bno055 *b, double t)
{
	switch (b->fault) {
	case EMU_IMU_STUCK:
		return;
	case EMU_IMU_GARBAGE:
		put_garbage(b);
		return;
	case EMU_IMU_ZERO:
		memset(b->reg + ACC, 0, BNO_DATA);
		return;
	case EMU_IMU_SLOW:
		if (t < b->updated)
			return;
		b->updated += 1 / b->fault_value;
		break;
	}
	put_data(b);
	if (b->fault == EMU_IMU_DELAYED)
		put_late(b);
}

static bool answers(struct bno055 *b, double t)
{
	if (!b->powered || t < b->ready || b->fault == EMU_IMU_OFF)
		return false;
	return b->fault != EMU_IMU_INTERMITTENT ||
	       noise_next(&b->noise) / 4294967296.0 >= b->fault_value;
}

/* --- modes and calibration --------------------------------------------- */

static int level(double t, double after)
{
	if (after < 0)
		return 0;
	return t >= after ? 3 : (int)(3 * t / after);
}

/* What self-calibration finds is the true zero error. */
static void found(struct bno055 *b, int group, int from, double per)
{
	for (int i = 0; i < 3; i++) {
		long n = lround(b->zero[from + i] * per);

		b->offset[group * 3 + i] = (int16_t)n;
		b->reg[OFFSETS + group * 6 + 2 * i] = (uint8_t)n;
		b->reg[OFFSETS + group * 6 + 2 * i + 1] = (uint8_t)(n >> 8);
	}
}

static void calibrate(struct bno055 *b, double t)
{
	double run = b->fused + (fusion(b->mode) ? t - b->fused_from : 0);
	int sys = level(run, b->calib_after[0]);
	int gyr = level(run, b->calib_after[1]);
	int acc = b->restored ? 3 : level(run, b->calib_after[2]);
	uint8_t old = b->reg[CALIB_STAT];

	if (gyr == 3 && (old >> 4 & 3) != 3)
		found(b, 2, 0, 16 * 180 / M_PI);
	if (acc == 3 && (old >> 2 & 3) != 3 && !b->restored)
		found(b, 0, 3, 100);
	b->reg[CALIB_STAT] = (uint8_t)(sys << 6 | gyr << 4 | acc << 2);
}

static void settle_mode(struct bno055 *b, double t)
{
	if (b->mode == b->wanted || t < b->switched)
		return;
	if (fusion(b->mode))
		b->fused += b->switched - b->fused_from;
	b->mode = b->wanted;
	b->fused_from = b->switched;
	b->reg[OPR_MODE] = b->mode;
	b->reg[SYS_STATUS] = b->mode == 0 ? 0 : fusion(b->mode) ? 5 : 6;
}

void bno_sample(struct bno055 *b, double t)
{
	bool changing = b->mode != b->wanted;

	b->next = t + b->period;
	filter_to(b, t);
	settle_mode(b, t);
	if (b->mode == 0 || changing || b->reg[PWR_MODE] == 2)
		return;
	if (fusion(b->mode))
		calibrate(b, t);
	update(b, t);
}

static void want_mode(struct bno055 *b, uint8_t mode, double t)
{
	if (mode > 0x0C || mode == b->wanted)
		return;
	settle_mode(b, t);
	b->wanted = mode;
	b->switched = t + (b->mode ? 0.019 : 0) + (mode ? 0.007 : 0);
	if (b->mode == b->wanted) /* back before it began */
		b->switched = t;
}

/* --- bus --------------------------------------------------------------- */

bool bno_address(struct bno055 *b, bool read, double t)
{
	if (!answers(b, t))
		return false;
	settle_mode(b, t);
	if (read)
		memcpy(b->burst, b->reg, sizeof b->burst);
	else
		b->pointer_set = false;
	return true;
}

static void write_offset(struct bno055 *b, int reg, uint8_t v)
{
	int group = (reg - OFFSETS) / 6, last = OFFSETS + group * 6 + 5;

	b->reg[reg] = v;
	if (reg != last || group > 2)
		return; /* a group takes effect with its last byte */
	for (int i = 0; i < 3; i++) {
		int at = OFFSETS + group * 6 + 2 * i;

		b->offset[group * 3 + i] =
			(int16_t)(b->reg[at] | b->reg[at + 1] << 8);
	}
	if (group == 0)
		b->restored = true;
}

static void write_register(struct bno055 *b, int reg, uint8_t v, double t)
{
	bool config = b->mode == 0 && b->wanted == 0;

	if (reg == PAGE_ID)
		b->page = v & 1;
	else if (b->page)
		return; /* page 1: sensor settings that fusion ignores */
	else if (reg == OPR_MODE)
		want_mode(b, v & 0x0F, t);
	else if (reg == SYS_TRIGGER && v & 0x20)
		bno_restart(b, t);
	else if (reg == SYS_TRIGGER || reg < FIRST_WRITABLE || !config)
		return;
	else if (reg >= OFFSETS && reg <= OFFSETS_END)
		write_offset(b, reg, v);
	else
		b->reg[reg] = v;
}

bool bno_write(struct bno055 *b, uint8_t v, double t)
{
	if (!b->powered || t < b->ready)
		return false;
	settle_mode(b, t);
	if (!b->pointer_set) {
		b->pointer_set = true;
		b->pointer = v & 0x7F;
		return true;
	}
	write_register(b, b->pointer, v, t);
	b->pointer = (b->pointer + 1) & 0x7F;
	return true;
}

uint8_t bno_read(struct bno055 *b)
{
	uint8_t reg = b->pointer;

	b->pointer = (b->pointer + 1) & 0x7F;
	if (reg == PAGE_ID)
		return b->page;
	return b->page ? (uint8_t)(reg ^ 0x5A) : b->burst[reg];
}
