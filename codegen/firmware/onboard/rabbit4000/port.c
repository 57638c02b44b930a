/* port: the onboard program on a Rabbit 4000 (RCM4100): three serial ports, the real-time clock, the watchdog
 * Source: Rabbit 4000 Microprocessor User's Manual, chapters 4 (clock, watchdog), 6 (interrupts), timer A,
 * and serial ports; addresses as in SDCC's rab/r3k.h.
 *
 * NOT TRIED ON A BOARD. The simulator ucsim has no serial ports. With bytes laid at their addresses, the
 * handlers move them both ways, and the clock counts. It cannot show that the registers mean what is said
 * here: check them against the manual. Two functions at the end, board_start and board_play, depend on the
 * module and its wiring. They are empty: until they are written, no line and no tone works.
 *
 * radio                serial port C, bit rate by timer A6
 * receiver             serial port D, timer A7
 * inertial unit        serial port E, timer A2; a 4-byte FIFO
 *
 * Interrupts: a handler may use neither floating point nor the alternate registers (float.s keeps values
 * there). It keeps its priority to its end (__critical), since a byte that waits would interrupt it again at
 * once. */
#include "port.h"

#include "ring.h"

#include <rab/r3ka.h>

#pragma codeseg CODE /* never switched out: an interrupt may come while the other bank is in */

/* Of the peripherals: twice the crystal's 29.4912 MHz, so board_start must switch the doubler on. */
#ifndef BOARD_CLOCK_HZ
#define BOARD_CLOCK_HZ 58982400UL
#endif
#ifndef GPS_BAUD
#define GPS_BAUD 38400UL
#endif
#ifndef IMU_BAUD
#define IMU_BAUD 115200UL
#endif
#ifndef RADIO_BAUD
#define RADIO_BAUD 57600UL
#endif

/* Timer A counts half the clock down from this to 0; a bit is 16 rounds. */
#define DIVIDER(baud) ((uint8_t)((BOARD_CLOCK_HZ / (32UL * (baud))) - 1UL))

#define RECEIVED 0x80U  /* status: a byte has come */
#define OCCUPIED 0x08U  /* status: a byte waits for the transmitter */
#define ASYNC_8 0x01U   /* control: 8 data bits, input from port C's pin, interrupts of priority 1 */
#define TIMER_ON 0x01U  /* TACSR */
#define HIT_2_S 0x5AU   /* WDTCR: 2 s from now to the reset */

/* The table of internal interrupts: 16 bytes each, at the lowest address of RAM (--data-loc is behind it). */
#define VECTORS 0xE000
#define VECTORS_SIZE 512U
#define VECTOR_SIZE 16U
#define SERIAL_C 0x0E0U
#define SERIAL_D 0x0F0U
#define SERIAL_E 0x1C0U
#define JP 0xC3U      /* opcodes: jump, */
#define IPRES_1 0xEDU /* the priority as before, */
#define IPRES_2 0x5DU
#define RET 0xC9U     /* return */

static volatile uint8_t __at(VECTORS) vectors[VECTORS_SIZE];

static ring received[PORT_SOURCES];
static ring to_send;

void radio_interrupt(void) __critical __interrupt;
void gps_interrupt(void) __critical __interrupt;
void imu_interrupt(void) __critical __interrupt;
static void board_start(void);
static void board_play(uint16_t tone_hz, bool vibrate_left, bool vibrate_right);

/* Give the transmitter its next byte if it takes one. */
static void send_next(void)
{
    uint8_t byte;

    if ((SCSR & OCCUPIED) == 0U) {
        if (ring_take(&to_send, &byte)) {
            SCDR = byte;
        } else {
            SCSR = 0U; /* any value: it clears the transmitter's interrupt */
        }
    }
}

void radio_interrupt(void) __critical __interrupt
{
    if ((SCSR & RECEIVED) != 0U) {
        ring_put(&received[PORT_RADIO], SCDR);
    }
    send_next();
}

void gps_interrupt(void) __critical __interrupt
{
    if ((SDSR & RECEIVED) != 0U) {
        ring_put(&received[PORT_GPS], SDDR);
    }
}

void imu_interrupt(void) __critical __interrupt
{
    if ((SESR & RECEIVED) != 0U) { /* other bytes in the FIFO interrupt again */
        ring_put(&received[PORT_IMU], SEDR);
    }
}

/* Let an interrupt jump to its handler. */
static void set_vector(uint16_t vector, void (*handler)(void))
{
    const uint16_t address = (uint16_t)handler;

    vectors[vector] = JP;
    vectors[vector + 1U] = (uint8_t)(address & 0xFFU);
    vectors[vector + 2U] = (uint8_t)(address >> 8);
}

/* All interrupts but the three return at once. */
static void set_vectors(void)
{
    for (uint16_t i = 0U; i < VECTORS_SIZE; i += VECTOR_SIZE) {
        vectors[i] = IPRES_1;
        vectors[i + 1U] = IPRES_2;
        vectors[i + 2U] = RET;
    }
    set_vector(SERIAL_C, radio_interrupt);
    set_vector(SERIAL_D, gps_interrupt);
    set_vector(SERIAL_E, imu_interrupt);
}

/* Set the table's address, and priority 0, at which all others interrupt. */
static void enable_interrupts(void)
{
    __asm
    ld a, #0xc0
    ld iir, a
    ipset 0
    __endasm;
}

void port_init(void)
{
    board_start();
    TAT6R = DIVIDER(RADIO_BAUD);
    TAT7R = DIVIDER(GPS_BAUD);
    TAT2R = DIVIDER(IMU_BAUD);
    TACR = 0U; /* all count half the clock, none interrupts */
    TACSR = TIMER_ON;
    set_vectors();
    SCCR = ASYNC_8;
    SDCR = ASYNC_8;
    SECR = ASYNC_8;
    enable_interrupts();
}

/* From the real-time clock, which goes on without power if VBAT has a battery: without one, sessions repeat, and
 * recordings of the radio are obeyed. In 1/128 s, the same again after 388 days. */
uint32_t port_session(void)
{
    uint32_t session;

    RTC0R = 0U; /* any value: the count is held for reading */
    session = RTC1R;
    session |= (uint32_t)RTC2R << 8;
    session |= (uint32_t)RTC3R << 16;
    session |= (uint32_t)RTC4R << 24;
    return session;
}

/* From the real-time clock, which counts 32768 a second. Its two lowest bytes are enough, since main asks
 * more often than every 2 s. */
uint32_t port_clock_ms(void)
{
    static uint16_t before;
    static uint32_t rest; /* 1/4096 ms */
    static uint32_t ms;
    uint16_t now;

    RTC0R = 0U; /* any value: the count is held for reading */
    now = RTC0R;
    now |= (uint16_t)((uint16_t)RTC1R << 8);
    rest += 125UL * (uint16_t)(now - before);
    before = now;
    ms += rest >> 12;
    rest &= 0xFFFUL;
    return ms;
}

uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    return ring_lend(&received[source], bytes);
}

/* A frame is sent whole or not at all. Interrupts are off meanwhile: the transmitter's takes from the same
 * ring. */
void port_send(const uint8_t *bytes, uint16_t count)
{
    if (count <= ring_room(&to_send)) {
        __critical
        {
            for (uint16_t i = 0U; i < count; i++) {
                ring_put(&to_send, bytes[i]);
            }
            send_next();
        }
    }
}

/* The program calls this once in each tick, so it resets the watchdog. */
void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    WDTCR = HIT_2_S;
    board_play(tone_hz, vibrate_left, vibrate_right);
}

/* ---- the board's: to be written ---- */

/* TO BE WRITTEN for the module and its wiring:
 * - clock: GCSR to the undivided main oscillator (after reset it is divided by 8), GCDR for the doubler
 * - memory: wait states of flash and RAM in MB0CR and MB2CR
 * - pins: PCFR, and where the alternate outputs are PxALR and PxAHR, for the transmitter of serial port C;
 *   inputs of C, D and E, which bits 5 and 4 of SCCR, SDCR and SECR choose (ASYNC_8: 00)
 * - pins of vibrators and buzzer as outputs, off */
static void board_start(void)
{
}

/* TO BE WRITTEN where there is a converter: battery and temperature, which are not told here. */
uint16_t port_battery_mv(void)
{
    return 0U;
}

int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

/* TO BE WRITTEN: a tone of so many Hz at the buzzer (a PWM channel or timer B), 0 for none, and the
 * vibrators. */
static void board_play(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    (void)tone_hz;
    (void)vibrate_left;
    (void)vibrate_right;
}
