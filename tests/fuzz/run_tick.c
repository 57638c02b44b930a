/* The inputs of fuzz_tick.c in files, one after the other, for compilers without libFuzzer; prints for each
 * the
 * modes that the controller has been in. */
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
uint32_t fuzz_modes(void);

int main(int argc, char **argv)
{
    static uint8_t data[1 << 20];

    for (int i = 1; i < argc; i++) {
        FILE *const file = fopen(argv[i], "rb");
        size_t size;

        if (file == NULL) {
            return 2;
        }
        size = fread(data, 1U, sizeof(data), file);
        (void)fclose(file);
        (void)printf("%s ", argv[i]);
        (void)fflush(stdout);
        (void)LLVMFuzzerTestOneInput(data, size);
        (void)printf("%u\n", (unsigned)fuzz_modes());
    }
    return 0;
}
