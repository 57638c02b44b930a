/* port: the onboard program on ARM's MPS2 board with the AN386 image (a Cortex-M4F), which QEMU simulates
 * Source: ARM DAI 0386 (memory map, interrupts); ARM DDI 0479, CMSDK (UART, timer, watchdog); ARMv7-M
 * Architecture Reference Manual, B3.3 (SysTick), B3.4 (NVIC).
 *
 * radio                UART0
 * receiver             UART1
 * inertial unit        UART2
 * tone                 square wave at GPIO0, pin 0, by timer 0
 * vibrators            LED 0 the left one, LED 1 the right one
 *
 * Another board needs other registers in this file; rings, handlers' duties and interface stay. */
#include "port.h"

#include "ring.h"

#define CLOCK_HZ 25000000U /* of processor and peripherals */

#ifndef GPS_BAUD
#define GPS_BAUD 38400U
#endif
#ifndef IMU_BAUD
#define IMU_BAUD 115200U
#endif
#ifndef RADIO_BAUD
#define RADIO_BAUD 57600U
#endif

typedef struct {
    volatile uint32_t data;
    volatile uint32_t state;
    volatile uint32_t control;
    volatile uint32_t interrupt; /* 1 clears: bit 0 transmitter, bit 1 receiver */
    volatile uint32_t divider;   /* clocks of a bit */
} uart_registers;

typedef struct {
    volatile uint32_t control;
    volatile uint32_t value;
    volatile uint32_t reload;
    volatile uint32_t interrupt; /* 1 clears */
} timer_registers;

typedef struct {
    volatile uint32_t load;
    volatile uint32_t value;
    volatile uint32_t control;
    volatile uint32_t clear; /* of the interrupt, and the count begins anew */
} watchdog_registers;

typedef struct {
    volatile uint32_t input;
    volatile uint32_t output;
    uint32_t reserved[2];
    volatile uint32_t output_enable;
} gpio_registers;

/* the registers' addresses are the board's: MISRA C:2012, rule 11.4, deviation */
#define TIMER0 ((timer_registers *)0x40000000U)
#define UART0 ((uart_registers *)0x40004000U)
#define UART1 ((uart_registers *)0x40005000U)
#define UART2 ((uart_registers *)0x40006000U)
#define WATCHDOG ((watchdog_registers *)0x40008000U)
#define GPIO0 ((gpio_registers *)0x40010000U)
#define LEDS (*(volatile uint32_t *)0x40028000U)
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018U)
#define NVIC_ENABLE (*(volatile uint32_t *)0xE000E100U)

#define INTERRUPT(number) (1UL << (uint32_t)(number)) /* NVIC_ENABLE */

#define UART_TX_FULL 1U /* state */
#define UART_TX 1U      /* control: transmitter, receiver, and their interrupts */
#define UART_RX 2U
#define UART_TX_INTERRUPT 4U
#define UART_RX_INTERRUPT 8U
#define UART_TX_DONE 1U /* interrupt */
#define UART_RX_DONE 2U

#define SYSTICK_ON 7U /* counts, interrupts, by the processor's clock */
#define TIMER_ON 9U   /* counts, interrupts */
#define WATCHDOG_ON 3U

#define BUZZER 1U /* pin of GPIO0 */
#define LEFT 1UL  /* LED */
#define RIGHT 2UL

enum { UART0_RX, UART0_TX, UART1_RX, UART1_TX, UART2_RX, TIMER_0 = 8, VECTORS };

static ring received[PORT_SOURCES];
static ring to_send;
static volatile uint32_t clock_ms;

typedef void (*handler)(void);

void NMI_Handler(void);
void SysTick_Handler(void);

/* Put the UART's byte into the ring. It must be fetched before the next has come: 87 us at 115200 baud. */
static void receive(uart_registers *uart, port_source source)
{
    uart->interrupt = UART_RX_DONE; /* first: a byte that comes from here on interrupts again */
    ring_put(&received[source], (uint8_t)uart->data);
}

static void radio_received(void)
{
    receive(UART0, PORT_RADIO);
}

static void gps_received(void)
{
    receive(UART1, PORT_GPS);
}

static void imu_received(void)
{
    receive(UART2, PORT_IMU);
}

/* The UART is free: send what waits. If nothing does, port_send starts it again. */
static void radio_sent(void)
{
    uint8_t byte;

    UART0->interrupt = UART_TX_DONE;
    while (((UART0->state & UART_TX_FULL) == 0U) && ring_take(&to_send, &byte)) {
        UART0->data = byte;
    }
}

static void half_wave(void)
{
    TIMER0->interrupt = 1U;
    GPIO0->output ^= BUZZER;
}

void SysTick_Handler(void)
{
    clock_ms = clock_ms + 1U;
}

/* The watchdog's warning: the program hangs. Wait for the reset. */
void NMI_Handler(void)
{
    for (;;) {
    }
}

/* The board's interrupts, behind the processor's own (startup.c). */
__attribute__((used, section(".vectors.board"))) static const handler vectors[VECTORS] = {
    [UART0_RX] = radio_received, [UART0_TX] = radio_sent,   [UART1_RX] = gps_received,
    [UART2_RX] = imu_received,   [TIMER_0] = half_wave};

static void open_uart(uart_registers *uart, uint32_t baud, uint32_t control)
{
    uart->divider = CLOCK_HZ / baud;
    uart->control = control;
}

void port_init(void)
{
    open_uart(UART0, RADIO_BAUD, UART_TX | UART_RX | UART_TX_INTERRUPT | UART_RX_INTERRUPT);
    open_uart(UART1, GPS_BAUD, UART_RX | UART_RX_INTERRUPT);
    open_uart(UART2, IMU_BAUD, UART_RX | UART_RX_INTERRUPT);
    GPIO0->output_enable = BUZZER;
    SYSTICK_RELOAD = (CLOCK_HZ / 1000U) - 1U;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = SYSTICK_ON;
    WATCHDOG->load = CLOCK_HZ; /* 1 s to the warning, and another to the reset */
    WATCHDOG->control = WATCHDOG_ON;
    NVIC_ENABLE = INTERRUPT(UART0_RX) | INTERRUPT(UART0_TX) | INTERRUPT(UART1_RX) | INTERRUPT(UART2_RX) |
                  INTERRUPT(TIMER_0);
}

/* A count of resets. THIS BOARD KEEPS IT IN RAM, which loses it with the power: a vest's board must keep it in
 * flash, in memory with a battery, or draw it from noise. Else recordings of the radio are obeyed. */
uint32_t port_session(void)
{
    static uint32_t resets __attribute__((section(".noinit")));

    resets++;
    return resets;
}

uint32_t port_clock_ms(void)
{
    return clock_ms;
}

uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    return ring_lend(&received[source], bytes);
}

/* A frame is sent whole or not at all. Interrupts are off meanwhile: the UART's takes from the same ring. */
void port_send(const uint8_t *bytes, uint16_t count)
{
    if (count <= ring_room(&to_send)) {
        __asm__ volatile("cpsid i" ::: "memory");
        for (uint16_t i = 0U; i < count; i++) {
            ring_put(&to_send, bytes[i]);
        }
        radio_sent();
        __asm__ volatile("cpsie i" ::: "memory");
    }
}

/* This board measures neither. */
uint16_t port_battery_mv(void)
{
    return 0U;
}

int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

/* The program calls this once in each tick, so it resets the watchdog. */
void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    static uint16_t tone = 0U;

    WATCHDOG->clear = 1U;
    LEDS = (vibrate_left ? LEFT : 0UL) | (vibrate_right ? RIGHT : 0UL);
    if (tone != tone_hz) {
        tone = tone_hz;
        TIMER0->control = 0U;
        GPIO0->output &= ~BUZZER;
        if (tone_hz > 0U) {
            TIMER0->reload = (CLOCK_HZ / (2U * (uint32_t)tone_hz)) - 1U;
            TIMER0->value = TIMER0->reload;
            TIMER0->control = TIMER_ON;
        }
    }
}
