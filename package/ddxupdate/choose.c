/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "choose.h"

#include "boot.h"

int choose_read(const struct request *request, struct block *block) {
    struct boot boot;
    char text[BLOCK_SIZE];

    if (boot_open(&boot, request->boot, request->place.block_lock))
        return 1;
    const int error = boot_read(&boot, text);
    boot_close(&boot);
    if (!error && !block_parse(text, block))
        *block = (struct block){.slot = 'A'};
    return error ? 1 : 0;
}

int choose_write(const struct request *request, const struct block *block) {
    struct boot boot;
    char text[BLOCK_SIZE];

    if (boot_open(&boot, request->boot, request->place.block_lock))
        return 1;
    block_format(block, text);
    const int error = boot_write(&boot, text);
    boot_close(&boot);
    return error ? 1 : 0;
}
