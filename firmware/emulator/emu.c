/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * Life of a Nano and the run loop.
 *
 * simavr's own loop adds a cycle to each sleep and cuts where it is asked to
 * stop. This one sleeps to the next thing that can wake the MCU and to
 * nothing else, so that the place where a caller slices a run leaves no trace
 * in the program's time.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <simavr/sim_core_config.h>

#include "core.h"

#define F_CPU 16000000

static char last_log[256];

static void keep_log(struct avr_t *avr, const int level, const char *format,
		     va_list ap)
{
	(void)avr;
	if (level > LOG_ERROR)
		return;
	vsnprintf(last_log, sizeof last_log, format, ap);
}

const char *emu_log(void)
{
	return last_log;
}

int emu_abi(void)
{
	return EMU_ABI;
}

const char *emu_simavr(void)
{
	return CONFIG_SIMAVR_VERSION;
}

/* --- events ------------------------------------------------------------ */

static void run_events(emu_t *e)
{
	while (e->next_event <= e->avr->cycle) {
		int first = 0;

		for (int i = 1; i < EV_COUNT; i++)
			if (e->when[i] < e->when[first])
				first = i;
		switch (first) {
		case EV_TX: uart_tx_event(e); break;
		case EV_RX: uart_rx_event(e); break;
		case EV_TWI: twi_event(e); break;
		case EV_RING_A: wheel_event(e, 0); break;
		case EV_RING_B: wheel_event(e, 1); break;
		case EV_EEPROM: eeprom_event(e); break;
		case EV_NOISE_A: wheel_noise(e, 0); break;
		case EV_NOISE_B: wheel_noise(e, 1); break;
		case EV_BOOT: reset_event(e); break;
		case EV_WATCHDOG: watchdog_event(e); break;
		default: imu_event(e); break;
		}
	}
}

/* --- life -------------------------------------------------------------- */

static bool find_parts(emu_t *e)
{
	return watchdog_init(e) && uart_init(e) && twi_init(e) &&
	       pins_init(e) && wheel_init(e) && imu_init(e) &&
	       compare_init(e) && timer_flags_init(e) &&
	       eeprom_init(e) && divider_init(e) && probe_init(e);
}

emu_t *emu_new(const uint8_t *image, uint32_t n, uint32_t reset_pc)
{
	emu_t *e;

	if (n > FLASH_SIZE || reset_pc >= FLASH_SIZE)
		return NULL;
	avr_global_logger_set(keep_log);
	e = calloc(1, sizeof *e);
	if (!e)
		return NULL;
	e->avr = avr_make_mcu_by_name("atmega328p");
	if (!e->avr) {
		free(e);
		return NULL;
	}
	avr_init(e->avr);
	e->avr->frequency = F_CPU;
	e->avr->log = LOG_ERROR;
	e->avr->codeend = e->avr->flashend;
	e->avr->reset_pc = reset_pc;
	memcpy(e->avr->flash, image, n);
	e->hz = F_CPU;
	e->gate = e->next_event = e->uart.stop = NEVER;
	for (int i = 0; i < EV_COUNT; i++)
		e->when[i] = NEVER;
	emu_vcc(e, 5000);
	if (!find_parts(e)) {
		emu_free(e);
		return NULL;
	}
	emu_reset(e, EMU_POWER);
	return e;
}

void emu_free(emu_t *e)
{
	if (!e)
		return;
	uart_free(e);
	avr_terminate(e->avr);
	free(e->avr);
	free(e);
}

void emu_clock(emu_t *e, double hz)
{
	double old = e->hz;

	e->world_t = emu_world(e, e->now);
	e->world_c = e->now;
	e->hz = hz;
	wheel_clock(e, old);
	e->uart.host_bit *= hz / old;
	if (e->when[EV_IMU] != NEVER)
		emu_at(e, EV_IMU, emu_cycle(e, e->imu.next));
}

/* --- run loop ---------------------------------------------------------- */

/* Nothing to execute: to the next cycle that can change that. */
static void pass_time(emu_t *e)
{
	avr_t *avr = e->avr;
	uint64_t next = e->limit;

	if (avr->cycle_timers.timer && avr->cycle_timers.timer->when < next)
		next = avr->cycle_timers.timer->when;
	if (e->next_event < next)
		next = e->next_event;
	if (next > avr->cycle)
		avr->cycle = next;
}

/* Four cycles for the entry, four more when it woke the MCU. */
static void serve_interrupt(emu_t *e, bool slept)
{
	avr_t *avr = e->avr;
	uint8_t depth = avr->interrupts.running_ptr;

	avr_service_interrupts(avr);
	if (avr->interrupts.running_ptr > depth)
		avr->cycle += slept ? 8 : 4;
}

static bool stands(const emu_t *e)
{
	const avr_t *avr = e->avr;

	if (e->held || e->frozen || avr->state != cpu_Running)
		return true;
	return e->hang && avr->sreg[S_I] && !avr->interrupts.running_ptr;
}

/* Instructions up to the next timer, or the time until then at once. */
static void advance(emu_t *e, bool standing)
{
	avr_t *avr = e->avr;
	uint64_t timer = avr->cycle_timers.timer->when; /* the gate at least */

	if (!standing) {
		avr->run_cycle_count = timer > avr->cycle ?
				       timer - avr->cycle : 1;
		avr->pc = avr_run_one(avr);
	} else if (!avr->interrupt_state || !avr->sreg[S_I] ||
		   avr->state == cpu_Crashed) {
		pass_time(e);
	} /* else the interrupt first: the delay after SEI must not span a
	   * sleep, or the cut of a slice would show in it */
}

int emu_run(emu_t *e, uint64_t target)
{
	avr_t *avr = e->avr;
	int result = 0;

	e->limit = target;
	for (;;) {
		uint64_t stop = e->uart.stop < target ? e->uart.stop : target;
		bool slept;

		/* a delimiter's stop bit is an EV_TX: no step passes it */
		if (avr->cycle >= stop) {
			e->now = stop > e->now ? stop : e->now;
			if (stop == e->uart.stop) {
				e->uart.stop = NEVER;
				result |= EMU_DELIMITER;
			}
			break;
		}
		e->limit = stop;
		avr->run_cycle_limit = NEVER;
		emu_gate(e);
		slept = stands(e);
		advance(e, slept);
		avr_cycle_timer_process(avr);
		run_events(e);
		if (e->watchdog.bitten) {
			emu_reset(e, EMU_WATCHDOG);
			result |= EMU_RESET;
		} else if (e->torn) {
			e->torn = false;
			emu_reset(e, EMU_BROWNOUT);
			result |= EMU_RESET;
		} else if (avr->interrupt_state &&
			   avr->state != cpu_Crashed) {
			serve_interrupt(e, slept);
		}
	}
	if (avr->state == cpu_Crashed || avr->state == cpu_Done)
		result |= EMU_CRASHED;
	if (e->uart.out_read < e->uart.out_n &&
	    e->uart.out_at[e->uart.out_read] <= e->now)
		result |= EMU_BYTES;
	return result;
}

int emu_step(emu_t *e, uint64_t target, const double in[7])
{
	emu_wheel(e, in[0]);
	emu_imu(e, in + 1, in + 4);
	return emu_run(e, target);
}

uint64_t emu_now(const emu_t *e)
{
	return e->now;
}

int emu_flash_get(const emu_t *e, uint8_t *buf, int n)
{
	if (n < 0 || n > (int)FLASH_SIZE)
		return -1;
	memcpy(buf, e->avr->flash, (size_t)n);
	return n;
}
