/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "block.h"

#include <stdio.h>
#include <string.h>

static const char head[] = "# GRUB Environment Block\n";

/* The variable of that name, whose value is one of these characters. */
static char *variable(struct block *block, const char *name, size_t length, const char **values) {
    static const char slots[] = "AB", digits[] = "0123456789";
    const struct {
        const char *name, *values;
        char *value;
    } known[] = {{"slot", slots, &block->slot},
                 {"left", digits, &block->left},
                 {"begun", digits, &block->begun},
                 {"failed", slots, &block->failed}};

    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strlen(known[i].name) == length && !memcmp(known[i].name, name, length)) {
            *values = known[i].values;
            return known[i].value;
        }
    return NULL;
}

bool block_parse(const char text[BLOCK_SIZE], struct block *block) {
    const char *const end = text + BLOCK_SIZE;

    *block = (struct block){.slot = 'A'};
    if (memcmp(text, head, sizeof head - 1) != 0)
        return false;
    for (const char *line = text, *next; line < end; line = next + 1) {
        next = memchr(line, '\n', (size_t)(end - line));
        if (!next) /* the padding */
            return true;
        const char *sign = memchr(line, '=', (size_t)(next - line)), *values;
        char *value = sign && *line != '#' ? variable(block, line, (size_t)(sign - line), &values) : NULL;
        if (!value || sign + 1 == next)
            continue;
        if (sign + 2 != next || !sign[1] || !strchr(values, sign[1]))
            return false;
        *value = sign[1];
    }
    return true;
}

void block_format(const struct block *block, char text[BLOCK_SIZE]) {
    memset(text, '#', BLOCK_SIZE);
    char *at = text + sizeof head - 1;
    memcpy(text, head, sizeof head - 1);
    char lines[64];
    int length = 0;

    if (block->slot != 'A')
        length += snprintf(lines + length, sizeof lines - (size_t)length, "slot=%c\n", block->slot);
    if (block->left)
        length += snprintf(lines + length, sizeof lines - (size_t)length, "left=%c\n", block->left);
    if (block->begun)
        length += snprintf(lines + length, sizeof lines - (size_t)length, "begun=%c\n", block->begun);
    if (block->failed)
        length += snprintf(lines + length, sizeof lines - (size_t)length, "failed=%c\n", block->failed);
    memcpy(at, lines, (size_t)length);
}

bool block_has(const struct block *block, const char *line) {
    char known[16];

    for (int i = 0; i < 2; i++) {
        const char value = i ? block->begun : block->left;
        snprintf(known, sizeof known, "%s=%c", i ? "begun" : "left", value);
        if (value && !strcmp(known, line))
            return true;
    }
    return false;
}

void block_came_up(struct block *block, char here) {
    if (here == block->slot) {
        block->left = 0;
        block->begun = 0;
    } else if (block->left) {
        /* The chosen slot is on trial, and the loader could not start it, or has no boots left for it. */
        block->failed = block->slot;
        block->slot = here;
        block->left = 0;
        block->begun = 0;
    } else if (block->begun) {
        block->begun = '2'; /* the chosen slot gets one more chance in the next boot */
    }
    if (here == block->failed)
        block->failed = 0;
}

bool block_is_trial(const struct block *block, char here) {
    return block->left && block->slot == here;
}

char block_other(char slot) {
    return slot == 'A' ? 'B' : 'A';
}
