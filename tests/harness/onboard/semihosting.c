/* semihosting: the onboard program under QEMU, which reads and writes files for it
 * Source: Semihosting for AArch32 and AArch64, 2.0. For every tick `received` holds the mailbox as pil.h declares
 * it: counts and bytes; `replies` gets the record, what was sent and what is played. */
#include "onboard.h"
#include "pil.h"

#include <stddef.h>

#define SYS_OPEN 0x01U
#define SYS_WRITE 0x05U
#define SYS_READ 0x06U
#define SYS_EXIT 0x18U
#define READ_BINARY 1U /* modes of fopen */
#define WRITE_BINARY 5U
#define APPLICATION_EXIT 0x20026U

static uint32_t call(uint32_t operation, uintptr_t argument)
{
    register uint32_t r0 __asm__("r0") = operation;
    register uintptr_t r1 __asm__("r1") = argument;

    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t open_file(const char *name, uint32_t length, uint32_t mode)
{
    const uintptr_t block[3] = {(uintptr_t)name, mode, length};

    return call(SYS_OPEN, (uintptr_t)block);
}

/* Returns how many bytes were not moved. */
static uint32_t move(uint32_t operation, uint32_t file, const void *bytes, size_t size)
{
    const uintptr_t block[3] = {file, (uintptr_t)bytes, size};

    return call(operation, (uintptr_t)block);
}

int main(void)
{
    const uint32_t received = open_file("received", 8U, READ_BINARY);
    const uint32_t replies = open_file("replies", 7U, WRITE_BINARY);

    pil_start();
    while ((move(SYS_READ, received, pil_counts, sizeof(pil_counts)) == 0U) &&
           (move(SYS_READ, received, pil_received, sizeof(pil_received)) == 0U)) {
        pil_tick();
        (void)move(SYS_WRITE, replies, pil_recorded, sizeof(pil_recorded));
        (void)move(SYS_WRITE, replies, &pil_sent_count, sizeof(pil_sent_count));
        (void)move(SYS_WRITE, replies, pil_sent, sizeof(pil_sent));
        (void)move(SYS_WRITE, replies, &pil_tone_hz, sizeof(pil_tone_hz));
        (void)move(SYS_WRITE, replies, &pil_vibrate_left, sizeof(pil_vibrate_left));
        (void)move(SYS_WRITE, replies, &pil_vibrate_right, sizeof(pil_vibrate_right));
    }
    (void)call(SYS_EXIT, APPLICATION_EXIT);
    return 0;
}
