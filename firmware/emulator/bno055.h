/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Register and timing model of the BNO055: it is not Bosch's fusion. Times
 * are world seconds (double). Figures: Bosch BST-BNO055-DS000-14.
 */
#ifndef DART_BNO055_H
#define DART_BNO055_H

#include <stdbool.h>
#include <stdint.h>

#define BNO_LATE 128 /* samples, 1.28 s */
#define BNO_DATA 0x2C /* registers 0x08 to 0x33 */

struct bno055 {
	uint8_t reg[128];
	uint8_t burst[128]; /* data as one read transaction sees them */
	uint8_t page, pointer;
	bool powered, pointer_set;
	double ready;       /* acknowledges from here on */
	uint8_t mode, wanted; /* OPR_MODE; wanted != mode while switching */
	double switched;    /* end of the mode change */
	double in[6];       /* true gyro, linear acceleration */
	double filtered[6];
	double filter_t;
	double zero[6];     /* zero-rate and zero-g errors */
	double next, period;
	double calib_after[3]; /* s in a fusion mode until sys, gyr, acc = 3 */
	double fused, fused_from;
	int16_t offset[9];  /* in force: acc, mag, gyr */
	bool restored;      /* offsets were written by the host */
	int fault;
	double fault_value;
	double updated;     /* next update of a slow part */
	uint8_t late[BNO_LATE][BNO_DATA]; /* data of a delayed part */
	unsigned late_n;
	uint32_t noise;
};

void bno_init(struct bno055 *b);
void bno_power(struct bno055 *b, bool on, double t);
void bno_restart(struct bno055 *b, double t); /* 650 ms, registers lost */
void bno_config(struct bno055 *b); /* registers lost, no gap */
void bno_input(struct bno055 *b, const double gyro[3], const double lin[3],
	       double t);
/* Next update of the data registers; then bno_sample at that time. */
void bno_sample(struct bno055 *b, double t);

/* One I2C transaction: bno_address, then bytes. false = not acknowledged. */
bool bno_address(struct bno055 *b, bool read, double t);
bool bno_write(struct bno055 *b, uint8_t v, double t);
uint8_t bno_read(struct bno055 *b);

#endif
