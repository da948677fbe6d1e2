/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "ustar.h"

#include <string.h>

/* Octal digits, then zero bytes or spaces. */
static bool octal(const uint8_t *field, unsigned length, uint64_t *value) {
    unsigned at = 0;

    *value = 0;
    for (; at < length && field[at] >= '0' && field[at] <= '7'; at++)
        *value = *value << 3 | (uint64_t)(field[at] - '0');
    if (!at || at == length)
        return false;
    for (; at < length; at++)
        if (field[at] && field[at] != ' ')
            return false;
    return true;
}

static uint64_t checksum(const uint8_t block[USTAR_BLOCK]) {
    uint64_t sum = 0;

    for (int i = 0; i < USTAR_BLOCK; i++)
        sum += i >= 148 && i < 156 ? ' ' : block[i]; /* the sum's own field counts as spaces */
    return sum;
}

bool ustar_parse(const uint8_t block[USTAR_BLOCK], struct ustar_member *member) {
    uint64_t sum;

    if (memcmp(block + 257, "ustar\00000", 8) != 0 || !octal(block + 148, 8, &sum) || sum != checksum(block) ||
        !octal(block + 124, 12, &member->size) || block[156] != '0' || block[345])
        return false;
    memcpy(member->name, block, USTAR_NAME - 1);
    member->name[USTAR_NAME - 1] = 0;
    return true;
}

unsigned ustar_padding(uint64_t size) {
    return (unsigned)(-size % USTAR_BLOCK);
}
