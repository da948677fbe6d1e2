/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "symbol.h"

#include <string.h>

#include "bits.h"
#include "gf256.h"

void symbol_set(struct symbol *symbol, const uint8_t *packet, size_t size) {
    symbol->size = (uint16_t)(SYMBOL_PREFIX + size);
    symbol->data[0] = 0;
    put16(symbol->data + 1, (uint16_t)size);
    memcpy(symbol->data + SYMBOL_PREFIX, packet, size);
}

bool symbol_is(const struct symbol *symbol, const uint8_t *packet, size_t size) {
    const uint8_t *data;
    size_t bytes;

    return symbol_get(symbol, &data, &bytes) && bytes == size && !memcmp(data, packet, size);
}

void symbol_add(struct symbol *to, const struct symbol *from, uint8_t factor) {
    if (from->size > to->size) {
        memset(to->data + to->size, 0, from->size - to->size);
        to->size = from->size;
    }
    gf256_add(to->data, from->data, factor, from->size);
}

bool symbol_get(const struct symbol *symbol, const uint8_t **packet, size_t *size) {
    if (symbol->size < SYMBOL_PREFIX || symbol->data[0])
        return false;
    size_t room = symbol->size - SYMBOL_PREFIX;
    *packet = symbol->data + SYMBOL_PREFIX;
    *size = get16(symbol->data + 1);
    return *size <= room && gf256_is_zero(*packet + *size, room - *size);
}
