/* stm32f405: the registers of the STM32F405 that the port uses
 * Source: ST RM0090, 2.3 (memory map), 3.9 (flash), 7.3 (RCC), 8.4 (GPIO), 13.13 (ADC), 18.4 (TIM4), 21.4 (IWDG),
 * 24.4 (RNG), 30.6 (USART), table 61 (interrupts); ARMv7-M Architecture Reference Manual, B3.2 (VTOR), B3.3 (SysTick),
 * B3.4 (NVIC). Each name is what the manual's name says. */
#ifndef STM32F405_H
#define STM32F405_H

#include <stdint.h>

typedef struct {
    volatile uint32_t control;       /* CR */
    volatile uint32_t pll;           /* PLLCFGR */
    volatile uint32_t configuration; /* CFGR */
    volatile uint32_t interrupt;     /* CIR */
    volatile uint32_t reset[8];      /* AHB1RSTR, AHB2RSTR, AHB3RSTR, -, APB1RSTR, APB2RSTR, -, - */
    volatile uint32_t ahb1;          /* AHB1ENR: who has a clock */
    volatile uint32_t ahb2;
    volatile uint32_t ahb3;
    uint32_t reserved;
    volatile uint32_t apb1;
    volatile uint32_t apb2;
} rcc_registers;

#define RCC_HSI_ON (1UL << 0) /* control */
#define RCC_HSI_READY (1UL << 1)
#define RCC_HSE_ON (1UL << 16)
#define RCC_HSE_READY (1UL << 17)
#define RCC_PLL_ON (1UL << 24)
#define RCC_PLL_READY (1UL << 25)
#define RCC_PLL_RESERVED 0xF0BC8000UL /* pll: bits to be left as they are */
#define RCC_PLL_DIVIDER(m) ((uint32_t)(m))
#define RCC_PLL_FACTOR(n) ((uint32_t)(n) << 6)
#define RCC_PLL_BY_2 0UL /* behind it, for the processor */
#define RCC_PLL_BY_HSE (1UL << 22)
#define RCC_PLL_SLOW_DIVIDER(q) ((uint32_t)(q) << 24) /* behind it, for the random numbers */
#define RCC_SWITCH 3UL /* configuration: clock of the processor, 0 for the internal oscillator */
#define RCC_SWITCH_PLL 2UL
#define RCC_SWITCHED (3UL << 2)
#define RCC_SWITCHED_PLL (2UL << 2)
#define RCC_APB1_BY_4 (5UL << 10)
#define RCC_APB2_BY_2 (4UL << 13)
#define RCC_GPIO_A (1UL << 0) /* ahb1 */
#define RCC_GPIO_B (1UL << 1)
#define RCC_GPIO_C (1UL << 2)
#define RCC_RNG (1UL << 6)    /* ahb2 */
#define RCC_TIM4 (1UL << 2)   /* apb1 */
#define RCC_USART3 (1UL << 18)
#define RCC_USART1 (1UL << 4) /* apb2 */
#define RCC_USART6 (1UL << 5)
#define RCC_ADC1 (1UL << 8)

#define FLASH_WAITS 7UL   /* FLASH_ACR: wait states of a read */
#define FLASH_5_WAITS 5UL /* for 168 MHz at 2.7 V and more */
#define FLASH_PREFETCH (1UL << 8)
#define FLASH_CACHES (3UL << 9)

typedef struct {
    volatile uint32_t mode;        /* MODER: two bits a pin */
    volatile uint32_t open_drain;  /* OTYPER */
    volatile uint32_t speed;       /* OSPEEDR */
    volatile uint32_t pull;        /* PUPDR: two bits a pin */
    volatile uint32_t input;       /* IDR */
    volatile uint32_t output;      /* ODR */
    volatile uint32_t set;         /* BSRR: low half sets, high half clears */
    volatile uint32_t lock;        /* LCKR */
    volatile uint32_t function[2]; /* AFRL, AFRH: four bits a pin */
} gpio_registers;

#define GPIO_OUTPUT 1UL /* mode */
#define GPIO_FUNCTION 2UL
#define GPIO_ANALOG 3UL
#define GPIO_PULL_UP 1UL

typedef struct {
    volatile uint32_t status;    /* SR */
    volatile uint32_t data;      /* DR */
    volatile uint32_t divider;   /* BRR: clocks of a bit */
    volatile uint32_t control_1; /* CR1 */
    volatile uint32_t control_2;
    volatile uint32_t control_3;
} usart_registers;

#define USART_OVERRUN (1UL << 3) /* status */
#define USART_RECEIVED (1UL << 5)
#define USART_TX_FREE (1UL << 7)
#define USART_RX (1UL << 2) /* control_1: receiver, transmitter, and their interrupts */
#define USART_TX (1UL << 3)
#define USART_RX_INTERRUPT (1UL << 5)
#define USART_TX_INTERRUPT (1UL << 7)
#define USART_ON (1UL << 13)

typedef struct {
    volatile uint32_t control_1;  /* CR1 */
    volatile uint32_t control_2;
    volatile uint32_t slave_mode; /* SMCR */
    volatile uint32_t interrupt;  /* DIER */
    volatile uint32_t status;     /* SR */
    volatile uint32_t event;      /* EGR */
    volatile uint32_t mode_1;     /* CCMR1: of channels 1 and 2 */
    volatile uint32_t mode_2;     /* CCMR2: of channels 3 and 4 */
    volatile uint32_t enable;     /* CCER */
    volatile uint32_t count;      /* CNT */
    volatile uint32_t prescaler;  /* PSC */
    volatile uint32_t reload;     /* ARR */
    uint32_t reserved;
    volatile uint32_t compare[4]; /* CCR1 to CCR4 */
} timer_registers;

#define TIMER_ON 1UL     /* control_1 */
#define TIMER_UPDATE 1UL /* event: prescaler and count begin anew */
#define TIMER_PWM_3 (6UL << 4)  /* mode_2: channel 3 is high while the count is below compare */
#define TIMER_OUT_3 (1UL << 8)  /* enable */
#define TIMER_CHANNEL_3 2U      /* compare */

typedef struct {
    volatile uint32_t key;       /* KR */
    volatile uint32_t prescaler; /* PR */
    volatile uint32_t reload;    /* RLR */
    volatile uint32_t status;    /* SR: which of the two is being taken over */
} watchdog_registers;

#define WATCHDOG_START 0xCCCCUL /* key */
#define WATCHDOG_OPEN 0x5555UL
#define WATCHDOG_FEED 0xAAAAUL
#define WATCHDOG_BY_8 1UL /* prescaler */
#define WATCHDOG_BUSY 3UL /* status */

typedef struct {
    volatile uint32_t control; /* CR */
    volatile uint32_t status;  /* SR */
    volatile uint32_t data;    /* DR */
} rng_registers;

#define RNG_ON (1UL << 2)    /* control */
#define RNG_READY (1UL << 0) /* status */
#define RNG_FAULTS 0x66UL    /* clock or seed: now (bits 1, 2), or since they were cleared (bits 5, 6) */

typedef struct {
    volatile uint32_t status;    /* SR */
    volatile uint32_t control_1; /* CR1 */
    volatile uint32_t control_2; /* CR2 */
    volatile uint32_t sampling[2]; /* SMPR1: channels 10 to 18; SMPR2: 0 to 9; three bits each */
    uint32_t injected[4];          /* JOFR1 to 4 */
    volatile uint32_t high;        /* HTR */
    volatile uint32_t low;         /* LTR */
    volatile uint32_t sequence[3]; /* SQR1 to SQR3: the first channel is in SQR3 */
    uint32_t injected_too[5];      /* JSQR, JDR1 to 4 */
    volatile uint32_t data;        /* DR */
} adc_registers;

#define ADC_DONE (1UL << 1)  /* status */
#define ADC_ON (1UL << 0)    /* control_2 */
#define ADC_START (1UL << 30)
#define ADC_480_CLOCKS 7UL   /* sampling: for a source of some 100 kOhm */
#define ADC_BY_4 (1UL << 16) /* ADC_CCR: clock */
#define ADC_REFERENCE_ON (1UL << 23)
#define ADC_REFERENCE 17UL /* channel: 1.21 V */
#define ADC_MOST 4095U

/* the registers' addresses are the chip's: MISRA C:2012, rule 11.4, deviation */
#define TIM4 ((timer_registers *)0x40000800U)
#define IWDG ((watchdog_registers *)0x40003000U)
#define USART3 ((usart_registers *)0x40004800U)
#define USART1 ((usart_registers *)0x40011000U)
#define USART6 ((usart_registers *)0x40011400U)
#define ADC1 ((adc_registers *)0x40012000U)
#define ADC_CCR (*(volatile uint32_t *)0x40012304U)
#define GPIOA ((gpio_registers *)0x40020000U)
#define GPIOB ((gpio_registers *)0x40020400U)
#define GPIOC ((gpio_registers *)0x40020800U)
#define RCC ((rcc_registers *)0x40023800U)
#define FLASH_ACR (*(volatile uint32_t *)0x40023C00U)
#define RNG ((rng_registers *)0x50060800U)
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010U)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014U)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018U)
#define NVIC_ENABLE ((volatile uint32_t *)0xE000E100U) /* 32 interrupts a word */
#define SCB_VTOR (*(volatile uint32_t *)0xE000ED08U)
#define REFERENCE_AT_3300_MV (*(const volatile uint16_t *)0x1FFF7A2AU) /* ADC_REFERENCE, as the factory measured it */

#define SYSTICK_ON 7U /* counts, interrupts, by the processor's clock */

enum { IRQ_USART1 = 37, IRQ_USART3 = 39, IRQ_USART6 = 71, IRQS };

#endif
