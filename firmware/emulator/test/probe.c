/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * A small program for tests of the emulator, independent of the firmware:
 * UART at 500000 baud, echo of each byte, edge counters of D2 and D3 and a
 * command per letter:
 *   c: counts  'C' u16 u16      t: TWI read of the BNO055
 *   w: watchdog reset           k: watchdog interrupt, 'K' when it came
 *   e: EEPROM byte 0 + 1        W reg value: TWI write
 *   b n: TWBR                   g n: n SCL pulses by GPIO, level of SDA
 *   d: deaf for four bytes      p: toggle D4 (power of the BNO055)
 *   v: ADC of the bandgap       o: toggle D9 by OC1A at each beat
 *   i: ICR1 (rising edge of D8, 0.5 us modulo 1 ms)
 *   l mode: WDTCSR = mode, then a loop with interrupts off
 *   m mode: the same with interrupts on, 'K' at each of the watchdog's
 *   r address value: write a register     s address: read one
 * In its main loop it sleeps (IDLE). Boot: 'B' MCUSR.
 */
#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <stdint.h>

static volatile uint16_t edges[2];
static volatile uint8_t bitten;
static volatile uint8_t rx[64], rx_head;
static uint8_t rx_tail;
static uint8_t cause __attribute__((section(".noinit")));

void early(void) __attribute__((naked, used, section(".init3")));
void early(void)
{
	cause = MCUSR;
	MCUSR = 0;
	wdt_disable();
}

ISR(INT0_vect) { edges[0]++; }
ISR(INT1_vect) { edges[1]++; }
ISR(USART_RX_vect)
{
	uint8_t v = UDR0;

	rx[rx_head++ & 63] = v;
}
EMPTY_INTERRUPT(TIMER1_COMPA_vect)
ISR(WDT_vect) { bitten = 1; }

static void put(uint8_t v)
{
	while (!(UCSR0A & _BV(UDRE0)))
		;
	UDR0 = v;
}

static void put16(uint16_t v)
{
	put((uint8_t)v);
	put((uint8_t)(v >> 8));
}

/* One step; 0xFE when TWINT does not come within 20 ms. */
static uint8_t twi(uint8_t control)
{
	uint16_t n = 20000;

	TWCR = (uint8_t)(_BV(TWINT) | _BV(TWEN) | control);
	while (!(TWCR & _BV(TWINT)))
		if (!--n)
			return 0xFE;
	return TWSR & 0xF8;
}

/* 't' reg n: each TWSR status, then the n bytes; GPIOR0 marks every step. */
static void twi_read(uint8_t reg, uint8_t n)
{
	GPIOR0 = 1;
	put(twi(_BV(TWSTA)));
	GPIOR0 = 2;
	TWDR = 0x28 << 1;
	put(twi(0));
	GPIOR0 = 3;
	TWDR = reg;
	put(twi(0));
	GPIOR0 = 4;
	put(twi(_BV(TWSTA)));
	GPIOR0 = 5;
	TWDR = 0x28 << 1 | 1;
	put(twi(0));
	GPIOR0 = 6;
	while (n--) {
		put(twi(n ? _BV(TWEA) : 0));
		GPIOR0 = 7;
		put(TWDR);
	}
	TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
}

static void twi_write(uint8_t reg, uint8_t v)
{
	put(twi(_BV(TWSTA)));
	TWDR = 0x28 << 1;
	put(twi(0));
	TWDR = reg;
	put(twi(0));
	TWDR = v;
	put(twi(0));
	TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
}

/* n SCL pulses by GPIO with the TWI off, then the level of SDA. */
static void clock_bus(uint8_t n)
{
	TWCR = 0;
	PORTC &= (uint8_t)~(_BV(4) | _BV(5));
	while (n--) {
		DDRC |= _BV(5);
		DDRC &= (uint8_t)~_BV(5);
	}
	put(PINC >> 4 & 1);
}

static uint8_t get(void)
{
	uint8_t v;

	for (;;) {
		cli();
		if (rx_tail != rx_head)
			break;
		sleep_enable();
		sei();
		sleep_cpu();
	}
	v = rx[rx_tail++ & 63];
	sei();
	return v;
}

static void deaf(void)
{
	uint8_t i, n;
	uint16_t wait = 4000; /* 4000 x 6 cycles: over 3 bytes */

	cli();
	while (--wait)
		__asm__ volatile("nop");
	for (i = n = 0; UCSR0A & _BV(RXC0); n++) {
		i |= UCSR0A;
		(void)UDR0;
	}
	put(n);
	put(i & _BV(DOR0));
	sei();
}

static void bandgap(void)
{
	ADMUX = _BV(REFS0) | 14;
	ADCSRA = _BV(ADEN) | _BV(ADSC) | 7;
	while (ADCSRA & _BV(ADSC))
		;
	put16(ADC);
}

static void watchdog_interrupt(void)
{
	cli();
	wdt_reset();
	WDTCSR = _BV(WDCE) | _BV(WDE);
	WDTCSR = _BV(WDIE); /* 16 ms */
	sei();
	while (!bitten)
		;
	put('K');
	cli();
	wdt_disable();
	bitten = 0;
	sei();
}

static void watched_loop(uint8_t mode, uint8_t interrupts)
{
	cli();
	wdt_reset();
	WDTCSR = _BV(WDCE) | _BV(WDE);
	WDTCSR = mode;
	if (interrupts)
		sei();
	for (;;)
		if (bitten) {
			bitten = 0;
			put('K');
		}
}

static void command(uint8_t v)
{
	uint8_t a, b;
	uint16_t n, m;

	switch (v) {
	case 'c':
		cli();
		n = edges[0];
		m = edges[1];
		sei();
		put('C');
		put16(n);
		put16(m);
		break;
	case 't':
		a = get();
		twi_read(a, get());
		break;
	case 'W':
		a = get();
		b = get();
		twi_write(a, b);
		break;
	case 'g':
		clock_bus(get());
		break;
	case 'b':
		TWBR = get();
		break;
	case 'd':
		deaf();
		break;
	case 'w':
		wdt_enable(WDTO_15MS);
		for (;;)
			;
	case 'e':
		a = eeprom_read_byte((uint8_t *)0);
		eeprom_update_byte((uint8_t *)0, a + 1);
		put(a);
		break;
	case 'v':
		bandgap();
		break;
	case 'k':
		watchdog_interrupt();
		break;
	case 'o':
		DDRB |= _BV(1);
		TCCR1A |= _BV(COM1A0);
		break;
	case 'l':
		watched_loop(get(), 0);
		break;
	case 'm':
		watched_loop(get(), 1);
		break;
	case 'r':
		a = get();
		b = get();
		*(volatile uint8_t *)(uint16_t)a = b;
		break;
	case 's':
		put(*(volatile uint8_t *)(uint16_t)get());
		break;
	case 'i':
		put16(ICR1);
		break;
	case 'p':
		PORTD ^= _BV(4);
		break;
	default:
		put(v);
	}
}

int main(void)
{
	UBRR0 = 3;
	UCSR0A = _BV(U2X0);
	UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
	PORTD = _BV(2) | _BV(3) | _BV(4) | _BV(7); /* as firmware does: levels, */
	DDRD = _BV(4) | _BV(7);                    /* then directions */
	EICRA = _BV(ISC00) | _BV(ISC10);
	EIMSK = _BV(INT0) | _BV(INT1);
	TWBR = 12;
	TCCR1B = _BV(WGM12) | _BV(CS11) | _BV(ICES1); /* 1 ms beat wakes the loop */
	OCR1A = 1999;
	TIMSK1 = _BV(OCIE1A);
	sei();
	put('B');
	put(cause);
	put(0);
	for (;;)
		command(get());
}
