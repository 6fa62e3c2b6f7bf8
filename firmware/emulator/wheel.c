/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Two encoder rings on one shaft. Each mark's crossing is an event of its
 * own at the cycle where the integrated position meets it, so counts are
 * exact for any tick and any rate.
 */
#include <math.h>

#include "core.h"

static double position(const emu_t *e, uint64_t cycle)
{
	return e->wheel_pos +
	       e->wheel_rate * ((double)cycle - (double)e->wheel_c);
}

static double mark_position(const struct ring *r, int64_t k)
{
	int64_t rev = k / r->n, i = k % r->n;

	if (i < 0) {
		i += r->n;
		rev--;
	}
	return (double)rev + r->mark[i];
}

static void schedule(emu_t *e, int ring)
{
	struct ring *r = &e->ring[ring];
	double dt;

	if (!r->n || e->wheel_rate == 0) {
		emu_at(e, EV_RING_A + ring, NEVER);
		return;
	}
	dt = mark_position(r, e->wheel_rate > 0 ? r->k : r->k - 1) -
	     e->wheel_pos;
	dt = ceil(dt / e->wheel_rate);
	if (dt < 0)
		dt = 0;
	emu_at(e, EV_RING_A + ring,
	       dt < 1e15 ? e->wheel_c + (uint64_t)dt : NEVER);
}

static int at_pin(const emu_t *e, int ring)
{
	return e->ring[ring].level ^ e->ring[ring].flipped;
}

static void edge(emu_t *e, int ring)
{
	e->ring[ring].edges++;
	pins_input(e, 2, 2 + ring, at_pin(e, ring));
}

static void show(emu_t *e, int ring)
{
	struct ring *r = &e->ring[ring];
	int level = !(r->k & 1);

	/* an IR sensor without supply lets the pull-up win */
	if (ring == 0 && e->state[2][7] != PIN_HIGH)
		level = 1;
	if (level == r->level)
		return;
	r->level = level;
	edge(e, ring);
}

/* --- electrical noise on the wire --------------------------------------- */

static void next_noise(emu_t *e, int ring)
{
	struct ring *r = &e->ring[ring];
	double u = (noise_next(&r->noise) + 1.0) / 4294967297.0;

	r->noise_at += r->irregular ? -log(u) * r->noise_step : r->noise_step;
	emu_at(e, EV_NOISE_A + ring, (uint64_t)ceil(r->noise_at));
}

void wheel_noise(emu_t *e, int ring)
{
	e->ring[ring].flipped ^= 1;
	edge(e, ring);
	next_noise(e, ring);
}

int emu_chatter(emu_t *e, int ring, double edges_per_s, int irregular)
{
	struct ring *r = &e->ring[ring & 1];

	if (ring < 0 || ring > 1 || !(edges_per_s >= 0 && edges_per_s <= 2e6))
		return -1;
	if (edges_per_s > 0) {
		r->noise_step = e->hz / edges_per_s;
		r->noise_at = (double)e->now;
		r->irregular = irregular != 0;
		r->noise = 0x9E3779B9u + (uint32_t)ring;
		next_noise(e, ring);
		return 0;
	}
	emu_at(e, EV_NOISE_A + ring, NEVER);
	if (r->flipped) {
		r->flipped = 0;
		edge(e, ring);
	}
	return 0;
}

/* --- rings ---------------------------------------------------------------- */

/* D7 switched the IR sensor. */
static void sensor(emu_t *e, int state)
{
	(void)state;
	show(e, 0);
}

int wheel_init(emu_t *e)
{
	e->ring[0].level = e->ring[1].level = 1;
	e->hangs[2][7] = sensor;
	return 1;
}

void wheel_after_reset(emu_t *e)
{
	pins_input(e, 2, 2, at_pin(e, 0));
	pins_input(e, 2, 3, at_pin(e, 1));
}

void wheel_event(emu_t *e, int ring)
{
	e->ring[ring].k += e->wheel_rate > 0 ? 1 : -1;
	show(e, ring);
	schedule(e, ring);
}

void emu_wheel(emu_t *e, double rev_per_s)
{
	double rate = rev_per_s / e->hz;

	if (rate == e->wheel_rate || !isfinite(rate))
		return;
	e->wheel_pos = position(e, e->now);
	e->wheel_c = e->now;
	e->wheel_rate = rate;
	schedule(e, 0);
	schedule(e, 1);
}

void wheel_clock(emu_t *e, double old_hz)
{
	e->wheel_pos = position(e, e->now);
	e->wheel_c = e->now;
	e->wheel_rate *= old_hz / e->hz;
	schedule(e, 0);
	schedule(e, 1);
}

int emu_ring(emu_t *e, int ring, const double *mark, int n)
{
	struct ring *r = &e->ring[ring & 1];
	double pos = position(e, e->now), turn = floor(pos);

	if (ring < 0 || ring > 1 || n < 0 || n > RING_MARKS || n & 1)
		return -1;
	for (int i = 0; i < n; i++)
		if (!(mark[i] >= 0 && mark[i] < 1) ||
		    (i && !(mark[i] > mark[i - 1])))
			return -1;
	r->n = n;
	r->k = (int64_t)turn * n;
	for (int i = 0; i < n; i++) {
		r->mark[i] = mark[i];
		r->k += mark[i] <= pos - turn;
	}
	if (n == 0)
		r->k = 0;
	show(e, ring);
	schedule(e, ring);
	return 0;
}

double emu_position(const emu_t *e)
{
	return position(e, e->now);
}

uint64_t emu_edges(const emu_t *e, int ring)
{
	return ring < 0 || ring > 1 ? 0 : e->ring[ring].edges;
}
