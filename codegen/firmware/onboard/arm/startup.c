/* startup: from reset to main on a Cortex-M4F
 * Source: ARMv7-M Architecture Reference Manual, B1.5 (exceptions), B3.2.20 (CPACR). */
#include <stdint.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88U) /* coprocessor access control register */
#define FPU_ACCESS (0xFU << 20)                   /* full access to coprocessors 10 and 11, the FPU */

/* A board replaces such a handler by its own of the same name. */
#define REPLACEABLE __attribute__((weak))

typedef void (*handler)(void);

typedef struct {
    const uint32_t *stack;
    handler handlers[15]; /* of the processor's own exceptions, in the order of their numbers from 1 */
} vector_table;

/* from link.ld */
extern const uint32_t stack_top[];
extern const uint32_t data_load[];
extern uint32_t data_start[];
extern uint32_t data_end[];
extern uint32_t bss_start[];
extern uint32_t bss_end[];

int main(void);

void Reset_Handler(void);
void NMI_Handler(void);
void HardFault_Handler(void);
void MemManage_Handler(void);
void BusFault_Handler(void);
void UsageFault_Handler(void);
void SVC_Handler(void);
void DebugMon_Handler(void);
void PendSV_Handler(void);
void SysTick_Handler(void);

/* What the processor reads at reset, at address 0. A board's own interrupts (from number 16 on) follow it: a
 * table of theirs in the section .vectors.board. */
__attribute__((used, section(".vectors"))) static const vector_table vectors = {
    stack_top,
    {Reset_Handler, NMI_Handler, HardFault_Handler, MemManage_Handler, BusFault_Handler, UsageFault_Handler,
     0, 0, 0, 0, SVC_Handler, DebugMon_Handler, 0, PendSV_Handler, SysTick_Handler}};

/* No function that could use the FPU may be called before it is on. Its status and control register is left
 * at its reset value, which is what the program wants: round to nearest, subnormal numbers and NaN as in
 * IEEE 754. */
void Reset_Handler(void)
{
    const uint32_t *load = data_load;
    uint32_t *word = data_start;

    CPACR |= FPU_ACCESS;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    while (word != data_end) {
        *word = *load;
        word++;
        load++;
    }
    word = bss_start;
    while (word != bss_end) {
        *word = 0U;
        word++;
    }
    (void)main();
    HardFault_Handler(); /* main does not return */
}

/* Faults end here, for a debugger, or until the board's watchdog resets. */
REPLACEABLE void HardFault_Handler(void)
{
    for (;;) {
    }
}

REPLACEABLE void NMI_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void MemManage_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void BusFault_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void UsageFault_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void SVC_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void DebugMon_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void PendSV_Handler(void)
{
    HardFault_Handler();
}

REPLACEABLE void SysTick_Handler(void)
{
    HardFault_Handler();
}
