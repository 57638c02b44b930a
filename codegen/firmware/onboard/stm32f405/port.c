/* port: the onboard program on an STM32F405, wired as on Adafruit's Feather STM32F405 Express
 * Source: ST RM0090 and the datasheet DS8626 (pins, alternate functions); Adafruit's pinout of the Feather.
 *
 * radio                USART3: D1/TX is PB10, D0/RX is PB11
 * receiver             USART6: D5 is PC7 (RX)
 * inertial unit        USART1: SDA is PB7 (RX)
 * tone                 D9, PB8: square wave by timer 4, channel 3
 * vibrators            D11, PC3 the left one; D12, PC2 the right one
 * battery              A6, PA3: half of its voltage, by the Feather's own divider
 * lamp                 D13, PC1: lit while the crystal does not swing
 *
 * No wait is without end. Where the crystal does not start, the internal oscillator (1 %) takes its place before the
 * PLL. Without the PLL there is no noise for a session, and the watchdog resets. Such a reset, like any, makes all pins
 * inputs: what drives speaker and vibrators needs a resistor that keeps it off.
 *
 * QEMU (netduinoplus2) has the processor, at its full rate, the USARTs and timer 4. It has no registers for the rest:
 * there all bits read 0, and waits run out. */
#include "port.h"

#include "ring.h"
#include "stm32f405.h"

#ifndef CRYSTAL_MHZ
#define CRYSTAL_MHZ 12U /* 8 on most flight controllers */
#endif
#ifndef GPS_BAUD
#define GPS_BAUD 38400U
#endif
#ifndef IMU_BAUD
#define IMU_BAUD 115200U
#endif
#ifndef RADIO_BAUD
#define RADIO_BAUD 57600U
#endif
#ifndef BATTERY_TIMES
#define BATTERY_TIMES 2U /* the voltage at PA3; 0: nothing is wired there */
#endif

/* The PLL multiplies 1 MHz by 336; half of that is the processor's clock, and a 7th, 48 MHz, the noise generator's. */
#define CLOCK_HZ 168000000U
#define APB1_HZ (CLOCK_HZ / 4U) /* USART3 */
#define APB2_HZ (CLOCK_HZ / 2U) /* USART1, USART6, converter */
#define TIMER_HZ (CLOCK_HZ / 2U) /* TIM4: twice that of its bus */
#define INTERNAL_MHZ 16U
#define PLL_SETTING (RCC_PLL_FACTOR(336U) | RCC_PLL_BY_2 | RCC_PLL_SLOW_DIVIDER(7U))

/* Reads of a register, each of less than 1 us: all waits together end before the watchdog does. */
#define FEW_READS 5000U
#define CRYSTAL_READS 100000U /* it takes some ms */

/* Clocks of the slow oscillator divided by 8: 0.25 s, within 0.17 and 0.47 s as that oscillator varies. */
#define WATCHDOG_COUNT 1000U

#define DRAWS 8U /* attempts at a session */

#define TONE 8U     /* pins: of port B, */
#define RADIO_TX 10U
#define RADIO_RX 11U
#define IMU_RX 7U
#define GPS_RX 7U   /* of port C, */
#define LAMP 1U
#define RIGHT 2U
#define LEFT 3U
#define BATTERY 3U  /* of port A, and the converter's channel */
#define AF_TIM4 2U  /* alternate functions */
#define AF_USART1_3 7U
#define AF_USART6 8U

#define SET(pin) (1UL << (pin)) /* gpio_registers.set */
#define CLEAR(pin) (1UL << ((pin) + 16U))

static ring received[PORT_SOURCES];
static ring to_send;
static volatile uint32_t clock_ms;
static uint32_t vibrating; /* what was last written for the vibrators */

/* Only where there is no noise, in QEMU: who starts it sets the first of these, and a reset leaves them. */
static volatile uint32_t first_session __attribute__((section(".noinit")));
static uint32_t resets __attribute__((section(".noinit")));

extern const uint32_t vector_table[]; /* sections.ld */

typedef void (*handler)(void);

void SysTick_Handler(void);

/* Put the USART's byte into the ring. It must be fetched before the next has come: 87 us at 115200 baud. Reading status
 * and data clears all errors. A byte with an error is kept, and one that was overrun is lost: the protocols' checksums
 * reveal both, and count them. */
static void receive(usart_registers *usart, port_source source)
{
    if ((usart->status & (USART_RECEIVED | USART_OVERRUN)) != 0U) {
        ring_put(&received[source], (uint8_t)usart->data);
    }
}

/* Give the transmitter what it takes of what waits. It interrupts for more until nothing is left. */
static void send_waiting(void)
{
    uint8_t byte;
    bool waits = true;

    while (waits && ((USART3->status & USART_TX_FREE) != 0U)) {
        waits = ring_take(&to_send, &byte);
        if (waits) {
            USART3->data = byte;
        }
    }
    if (waits) {
        USART3->control_1 |= USART_TX_INTERRUPT;
    } else {
        USART3->control_1 &= ~USART_TX_INTERRUPT;
    }
}

static void radio_interrupt(void)
{
    receive(USART3, PORT_RADIO);
    send_waiting();
}

static void gps_interrupt(void)
{
    receive(USART6, PORT_GPS);
}

static void imu_interrupt(void)
{
    receive(USART1, PORT_IMU);
}

void SysTick_Handler(void)
{
    clock_ms = clock_ms + 1U;
}

/* The chip's interrupts, behind the processor's own (startup.c). */
__attribute__((used, section(".vectors.board"))) static const handler vectors[IRQS] = {
    [IRQ_USART1] = imu_interrupt, [IRQ_USART3] = radio_interrupt, [IRQ_USART6] = gps_interrupt};

/* Read a register until some of its bits are as wished, or it has been read often enough. Returns whether they are. */
static bool await(const volatile uint32_t *place, uint32_t bits, uint32_t wished, uint32_t reads)
{
    bool met = false;

    for (uint32_t i = 0U; !met && (i < reads); i++) {
        met = (*place & bits) == wished;
    }
    return met;
}

/* Set the processor's clock to CLOCK_HZ. Returns whether the crystal gives it.
 * A bootloader may have left another clock: begin with the one of a reset. */
static bool start_clock(void)
{
    bool crystal;

    RCC->control |= RCC_HSI_ON;
    (void)await(&RCC->control, RCC_HSI_READY, RCC_HSI_READY, FEW_READS);
    RCC->configuration &= ~RCC_SWITCH;
    (void)await(&RCC->configuration, RCC_SWITCHED, 0U, FEW_READS);
    RCC->control &= ~RCC_PLL_ON;
    (void)await(&RCC->control, RCC_PLL_READY, 0U, FEW_READS);

    RCC->control |= RCC_HSE_ON;
    crystal = await(&RCC->control, RCC_HSE_READY, RCC_HSE_READY, CRYSTAL_READS);
    RCC->pll = (RCC->pll & RCC_PLL_RESERVED) | PLL_SETTING |
               (crystal ? (RCC_PLL_BY_HSE | RCC_PLL_DIVIDER(CRYSTAL_MHZ)) : RCC_PLL_DIVIDER(INTERNAL_MHZ));
    RCC->control |= RCC_PLL_ON;
    FLASH_ACR = FLASH_5_WAITS | FLASH_PREFETCH | FLASH_CACHES;
    RCC->configuration = RCC_APB1_BY_4 | RCC_APB2_BY_2;
    if (await(&RCC->control, RCC_PLL_READY, RCC_PLL_READY, FEW_READS) &&
        await(&FLASH_ACR, FLASH_WAITS, FLASH_5_WAITS, FEW_READS)) {
        RCC->configuration |= RCC_SWITCH_PLL;
        (void)await(&RCC->configuration, RCC_SWITCHED, RCC_SWITCHED_PLL, FEW_READS);
    }
    return crystal;
}

/* Give the chip's parts their clocks, which they have two cycles later. */
static void start_parts(void)
{
    RCC->ahb1 |= RCC_GPIO_A | RCC_GPIO_B | RCC_GPIO_C;
    RCC->ahb2 |= RCC_RNG;
    RCC->apb1 |= RCC_TIM4 | RCC_USART3;
    RCC->apb2 |= RCC_USART1 | RCC_USART6 | RCC_ADC1;
    __asm__ volatile("dsb" ::: "memory");
    (void)RCC->apb2;
}

/* It cannot be stopped again. */
static void start_watchdog(void)
{
    IWDG->key = WATCHDOG_START;
    IWDG->key = WATCHDOG_OPEN;
    IWDG->prescaler = WATCHDOG_BY_8;
    IWDG->reload = WATCHDOG_COUNT;
    (void)await(&IWDG->status, WATCHDOG_BUSY, 0U, FEW_READS);
    IWDG->key = WATCHDOG_FEED;
}

static void set_pin(gpio_registers *port, uint32_t pin, uint32_t mode)
{
    const uint32_t place = 2U * pin;

    port->mode = (port->mode & ~(3UL << place)) | (mode << place);
}

/* Leave a pin to one of the chip's parts. */
static void give_pin(gpio_registers *port, uint32_t pin, uint32_t function)
{
    const uint32_t place = 4U * (pin % 8U);
    volatile uint32_t *const half = &port->function[pin / 8U];

    *half = (*half & ~(15UL << place)) | (function << place);
    set_pin(port, pin, GPIO_FUNCTION);
}

/* A line on which nothing is wired is quiet. */
static void pull_up(gpio_registers *port, uint32_t pin)
{
    const uint32_t place = 2U * pin;

    port->pull = (port->pull & ~(3UL << place)) | (GPIO_PULL_UP << place);
}

/* Outputs are low before they are outputs. */
static void start_pins(void)
{
    GPIOC->set = CLEAR(LAMP) | CLEAR(LEFT) | CLEAR(RIGHT);
    set_pin(GPIOC, LAMP, GPIO_OUTPUT);
    set_pin(GPIOC, LEFT, GPIO_OUTPUT);
    set_pin(GPIOC, RIGHT, GPIO_OUTPUT);
    pull_up(GPIOB, RADIO_RX);
    pull_up(GPIOB, IMU_RX);
    pull_up(GPIOC, GPS_RX);
    give_pin(GPIOB, RADIO_TX, AF_USART1_3);
    give_pin(GPIOB, RADIO_RX, AF_USART1_3);
    give_pin(GPIOB, IMU_RX, AF_USART1_3);
    give_pin(GPIOC, GPS_RX, AF_USART6);
    set_pin(GPIOA, BATTERY, GPIO_ANALOG);
}

/* The timer runs on; without a tone its output stays low. */
static void start_tone(void)
{
    TIM4->mode_2 = TIMER_PWM_3;
    TIM4->compare[TIMER_CHANNEL_3] = 0U;
    TIM4->enable = TIMER_OUT_3;
    TIM4->control_1 = TIMER_ON;
    give_pin(GPIOB, TONE, AF_TIM4);
}

static void start_converter(void)
{
    ADC_CCR = ADC_BY_4 | ADC_REFERENCE_ON;
    ADC1->sampling[0] = ADC_480_CLOCKS << (3U * (ADC_REFERENCE - 10U));
    ADC1->sampling[1] = ADC_480_CLOCKS << (3U * BATTERY);
    ADC1->sequence[2] = BATTERY;
    ADC1->control_2 = ADC_ON;
}

static void start_usart(usart_registers *usart, uint32_t divider, uint32_t parts)
{
    usart->divider = divider;
    usart->control_1 = USART_ON | USART_RX | USART_RX_INTERRUPT | parts;
}

static void enable_interrupt(uint32_t number)
{
    const uint32_t place = number % 32U;

    NVIC_ENABLE[number / 32U] = 1UL << place;
}

void port_init(void)
{
    SCB_VTOR = (uint32_t)vector_table; /* a bootloader leaves its own */
    start_watchdog();
    start_parts();
    start_pins();
    if (!start_clock()) {
        GPIOC->set = SET(LAMP);
    }
    start_tone();
    start_converter();
    start_usart(USART3, (APB1_HZ + (RADIO_BAUD / 2U)) / RADIO_BAUD, USART_TX);
    start_usart(USART6, (APB2_HZ + (GPS_BAUD / 2U)) / GPS_BAUD, 0U);
    start_usart(USART1, (APB2_HZ + (IMU_BAUD / 2U)) / IMU_BAUD, 0U);
    SYSTICK_RELOAD = (CLOCK_HZ / 1000U) - 1U;
    SYSTICK_VALUE = 0U;
    SYSTICK_CONTROL = SYSTICK_ON;
    enable_interrupt(IRQ_USART1);
    enable_interrupt(IRQ_USART3);
    enable_interrupt(IRQ_USART6);
}

/* A number of the noise generator, if it finds no fault in itself. */
static bool draw(uint32_t *number)
{
    const bool ready = await(&RNG->status, RNG_READY, RNG_READY, FEW_READS);

    *number = RNG->data;
    return ready && ((RNG->status & RNG_FAULTS) == 0U);
}

/* 32 bits of true noise. As the manual wishes, the first number is not used, and none that repeats the one before. A vest
 * without them would obey recordings: it waits for the watchdog's reset, and tries again. */
uint32_t port_session(void)
{
    uint32_t session = 0U;

    if ((RCC->control & RCC_HSI_READY) == 0U) { /* which every chip tells: this is QEMU, which has no noise */
        resets++;
        session = first_session + resets;
    } else {
        bool drawn = false;

        RNG->control = RNG_ON;

        for (uint32_t i = 0U; !drawn && (i < DRAWS); i++) {
            uint32_t first;

            drawn = draw(&first) && draw(&session) && (session != first);
            if (!drawn) {
                RNG->control = 0U;
                RNG->status = 0U;
                RNG->control = RNG_ON;
            }
        }
        if (!drawn) {
            for (;;) {
            }
        }
    }
    return session;
}

/* The main loop asks without end. The processor sleeps until the next interrupt: a ms at most. */
uint32_t port_clock_ms(void)
{
    __asm__ volatile("wfi" ::: "memory");
    return clock_ms;
}

uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    return ring_lend(&received[source], bytes);
}

/* A frame is sent whole or not at all. Interrupts are off meanwhile: the USART's takes from the same ring. */
void port_send(const uint8_t *bytes, uint16_t count)
{
    if (count <= ring_room(&to_send)) {
        __asm__ volatile("cpsid i" ::: "memory");
        for (uint16_t i = 0U; i < count; i++) {
            ring_put(&to_send, bytes[i]);
        }
        send_waiting();
        __asm__ volatile("cpsie i" ::: "memory");
    }
}

/* By turns the battery and the reference of 1.21 V are measured, each until the next call. The reference tells the supply,
 * which falls with an empty battery. */
uint16_t port_battery_mv(void)
{
    static uint32_t supply_mv = 0U;
    static uint32_t battery_mv = 0U;
    static bool reference = false; /* is what is being measured */

    if ((ADC1->status & ADC_DONE) != 0U) {
        const uint32_t value = ADC1->data & ADC_MOST;

        if (!reference) {
            battery_mv = (BATTERY_TIMES * value * supply_mv) / ADC_MOST;
        } else if (value > (REFERENCE_AT_3300_MV / 2U)) {
            supply_mv = (3300U * (uint32_t)REFERENCE_AT_3300_MV) / value;
        } else {
            supply_mv = 0U; /* no such supply: nothing is told */
        }
        reference = !reference;
    }
    ADC1->sequence[2] = reference ? ADC_REFERENCE : BATTERY;
    ADC1->control_2 = ADC_ON | ADC_START;
    return (uint16_t)battery_mv;
}

/* The chip's own sensor tells the chip, which is warmer than the pack by an unknown amount. */
int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

/* Play a tone of so many Hz, 0 for none; its period is a whole number of the timer's clocks, at most 65536. */
static void play(uint32_t tone_hz)
{
    TIM4->compare[TIMER_CHANNEL_3] = 0U;
    if (tone_hz > 0U) {
        const uint32_t clocks = TIMER_HZ / tone_hz;
        const uint32_t prescaler = clocks >> 16;
        const uint32_t period = clocks / (prescaler + 1U);

        TIM4->prescaler = prescaler;
        TIM4->reload = period - 1U;
        TIM4->event = TIMER_UPDATE;
        TIM4->compare[TIMER_CHANNEL_3] = period / 2U;
    }
}

/* The program calls this once in each tick, so it feeds the watchdog. */
void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    static uint16_t tone = 0U;
    const uint32_t vibrate =
        (vibrate_left ? SET(LEFT) : CLEAR(LEFT)) | (vibrate_right ? SET(RIGHT) : CLEAR(RIGHT));

    IWDG->key = WATCHDOG_FEED;
    if (vibrating != vibrate) {
        vibrating = vibrate;
        GPIOC->set = vibrate;
    }
    if (tone != tone_hz) {
        tone = tone_hz;
        play(tone_hz);
    }
}
