/* port: the onboard program on a computer with POSIX, a Linux single-board computer say
 * Source: POSIX.1-2008. The environment names the devices:
 *
 * VEST_GPS, VEST_IMU   serial devices; pipes and plain files work as well, to try things out
 * VEST_RADIO           serial device (of the XBee), read and written
 * VEST_PLAYS           file that gets a line for each change of tone or vibrators; standard error by default
 * VEST_CLOCK           file in the place of this computer's clock, for trials with a simulated animal, whose time may
 *                      run faster: two uint32_t in memory that another program shares. It counts up the first, ms;
 *                      the second is the time up to which all is done. For a real animal it is not set
 *
 * A line of VEST_PLAYS: ms since the start, Hz of the tone, left, right; `1240 1500 0 0`. */
#define _POSIX_C_SOURCE 200809L

#include "port.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#ifndef GPS_BAUD
#define GPS_BAUD B38400
#endif
#ifndef IMU_BAUD
#define IMU_BAUD B115200
#endif
#ifndef RADIO_BAUD
#define RADIO_BAUD B57600
#endif

#define NAP_NS 500000L /* half a ms */

typedef struct {
    const char *variable; /* of the environment */
    int mode;
    speed_t baud;
} line;

static const line lines[PORT_SOURCES] = {
    {"VEST_GPS", O_RDONLY, GPS_BAUD}, {"VEST_IMU", O_RDONLY, IMU_BAUD}, {"VEST_RADIO", O_RDWR, RADIO_BAUD}};

static int files[PORT_SOURCES];
static int plays = STDERR_FILENO;
static struct timespec start;
static volatile uint32_t *shared = NULL; /* the times of VEST_CLOCK, if that is set */

/* Open a file, or end the program: a vest needs all its lines. */
static int open_file(const char *variable, const char *name, int flags)
{
    const int file = (name != NULL) ? open(name, flags, S_IRUSR | S_IWUSR | S_IRGRP | S_IROTH) : -1;

    if (file < 0) {
        (void)fprintf(stderr, "%s: %s: %s\n", variable, (name != NULL) ? name : "not set",
                      (name != NULL) ? strerror(errno) : "expected a device, /dev/ttyUSB0 say");
        exit(EXIT_FAILURE);
    }
    return file;
}

/* Bytes as they are: 8 data bits, no parity, one stop bit, no flow control. */
static void set_line(int file, const line *l)
{
    struct termios settings;

    if (tcgetattr(file, &settings) == 0) { /* a pipe or a plain file has no settings */
        settings.c_iflag = 0;
        settings.c_oflag = 0;
        settings.c_lflag = 0;
        settings.c_cflag = CS8 | CREAD | CLOCAL;
        settings.c_cc[VMIN] = 0;
        settings.c_cc[VTIME] = 0;
        if ((cfsetispeed(&settings, l->baud) != 0) || (cfsetospeed(&settings, l->baud) != 0) ||
            (tcsetattr(file, TCSANOW, &settings) != 0)) {
            (void)fprintf(stderr, "%s: %s: cannot be set: %s\n", l->variable, getenv(l->variable),
                          strerror(errno));
            exit(EXIT_FAILURE);
        }
    }
}

/* Take the time from a file, or end the program: it would run at another time than its animal. */
static void set_clock(const char *name)
{
    const int file = open_file("VEST_CLOCK", name, O_RDWR);
    void *const mapped = mmap(NULL, 2U * sizeof(*shared), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);

    if (mapped == MAP_FAILED) {
        (void)fprintf(stderr, "VEST_CLOCK: %s: cannot be mapped: %s\n", name, strerror(errno));
        exit(EXIT_FAILURE);
    }
    (void)close(file);
    shared = mapped;
}

void port_init(void)
{
    const char *const name = getenv("VEST_PLAYS");
    const char *const clock = getenv("VEST_CLOCK");

    for (int i = 0; i < (int)PORT_SOURCES; i++) {
        const line *const l = &lines[i];

        files[i] = open_file(l->variable, getenv(l->variable), l->mode | O_NOCTTY | O_NONBLOCK);
        set_line(files[i], l);
    }
    if (name != NULL) {
        plays = open_file("VEST_PLAYS", name, O_WRONLY | O_CREAT | O_APPEND | O_NOCTTY | O_NONBLOCK);
    }
    if (clock != NULL) {
        set_clock(clock);
    }
    (void)clock_gettime(CLOCK_MONOTONIC, &start);
}

/* 32 bits of the system's noise. A vest without them would obey recordings: the program ends. */
uint32_t port_session(void)
{
    uint32_t session;
    const int file = open("/dev/urandom", O_RDONLY);

    if ((file < 0) || (read(file, &session, sizeof(session)) != (ssize_t)sizeof(session))) {
        (void)fprintf(stderr, "/dev/urandom: %s\n", strerror(errno));
        exit(EXIT_FAILURE);
    }
    (void)close(file);
    return session;
}

static uint32_t clock_ms(void)
{
    struct timespec now;
    uint32_t ms;

    if (shared != NULL) {
        ms = shared[0];
    } else {
        (void)clock_gettime(CLOCK_MONOTONIC, &now);
        ms = (uint32_t)((((int64_t)(now.tv_sec - start.tv_sec) * 1000000000) +
                         (int64_t)(now.tv_nsec - start.tv_nsec)) /
                        1000000);
    }
    return ms;
}

/* The main loop asks without end. The nap leaves the processor to other programs; it is the only wait in this
 * file, and shorter than a ms. */
uint32_t port_clock_ms(void)
{
    static uint32_t asked = 0U;
    const struct timespec nap = {0, NAP_NS};

    if (shared != NULL) {
        shared[1] = asked;
    }
    (void)nanosleep(&nap, NULL);
    asked = clock_ms();
    return asked;
}

/* A line that fails is silent, which the watchdog answers. */
uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    static uint8_t received[PORT_SOURCES][PORT_MOST];
    const ssize_t count = read(files[source], received[source], PORT_MOST);

    *bytes = received[source];
    return (count > 0) ? (uint16_t)count : 0U;
}

/* Bytes that the line does not take at once are lost, as on the air. */
void port_send(const uint8_t *bytes, uint16_t count)
{
    const ssize_t sent = write(files[PORT_RADIO], bytes, count);

    (void)sent;
}

/* Battery and temperature differ from computer to computer: not told. */
uint16_t port_battery_mv(void)
{
    return 0U;
}

int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    static bool written = false;
    static uint16_t tone = 0U;
    static bool left = false;
    static bool right = false;

    if (!written || (tone != tone_hz) || (left != vibrate_left) || (right != vibrate_right)) {
        written = true;
        tone = tone_hz;
        left = vibrate_left;
        right = vibrate_right;
        (void)dprintf(plays, "%lu %u %d %d\n", (unsigned long)clock_ms(), (unsigned)tone_hz,
                      vibrate_left ? 1 : 0, vibrate_right ? 1 : 0);
    }
}
