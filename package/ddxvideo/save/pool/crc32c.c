/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "crc32c.h"

#include <pthread.h>
#include <stdbool.h>
#include <string.h>

#define POLYNOMIAL 0x82f63b78u /* reflected */
#define LANES 8                /* bytes looked up at once */

static uint32_t table[LANES][256];
static pthread_once_t once = PTHREAD_ONCE_INIT;
static bool has_instruction;

static void prepare(void) {
    for (uint32_t byte = 0; byte < 256; byte++) {
        uint32_t crc = byte;

        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? POLYNOMIAL : 0);
        table[0][byte] = crc;
    }
    for (int lane = 1; lane < LANES; lane++)
        for (int byte = 0; byte < 256; byte++)
            table[lane][byte] = table[lane - 1][byte] >> 8 ^ table[0][table[lane - 1][byte] & 255];
#ifdef __x86_64__
    has_instruction = __builtin_cpu_supports("sse4.2");
#endif
}

#ifdef __x86_64__
/* Ten times as fast, which makes the checksums of a 1080p stream cheap. */
__attribute__((target("sse4.2"))) static uint32_t by_instruction(uint32_t crc, const unsigned char *at, size_t size) {
    uint64_t wide = crc;

    for (; size >= 8; size -= 8, at += 8) {
        uint64_t word;

        memcpy(&word, at, 8);
        wide = __builtin_ia32_crc32di(wide, word);
    }
    crc = (uint32_t)wide;
    for (; size; size--)
        crc = __builtin_ia32_crc32qi(crc, *at++);
    return crc;
}
#else
static uint32_t by_instruction(uint32_t crc, const unsigned char *at, size_t size) {
    (void)at, (void)size;
    return crc;
}
#endif

static uint32_t by_table(uint32_t crc, const unsigned char *at, size_t size) {
    for (; size >= LANES; size -= LANES, at += LANES) {
        uint32_t low = crc ^ ((uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24);

        crc = table[7][low & 255] ^ table[6][low >> 8 & 255] ^ table[5][low >> 16 & 255] ^ table[4][low >> 24] ^
              table[3][at[4]] ^ table[2][at[5]] ^ table[1][at[6]] ^ table[0][at[7]];
    }
    for (; size; size--)
        crc = crc >> 8 ^ table[0][(crc ^ *at++) & 255];
    return crc;
}

uint32_t crc32c(uint32_t crc, const void *bytes, size_t size) {
    pthread_once(&once, prepare);
    return ~(has_instruction ? by_instruction(~crc, bytes, size) : by_table(~crc, bytes, size));
}
