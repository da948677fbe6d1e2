/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The boot loader's block: what it contains, and what is no block. tests/host/test_slots.py has the decisions. */
#include <block.h>

#include "check.h"

#define HEAD "# GRUB Environment Block\n"

static bool parse(const char *lines, struct block *block) {
    char text[BLOCK_SIZE];

    memset(text, '#', sizeof text);
    memcpy(text, lines, strlen(lines));
    return block_parse(text, block);
}

static bool is(const struct block *block, char slot, char left, char begun, char failed) {
    return block->slot == slot && block->left == left && block->begun == begun && block->failed == failed;
}

int main(void) {
    struct block block;
    char text[BLOCK_SIZE];

    CHECK(parse(HEAD, &block) && is(&block, 'A', 0, 0, 0));
    CHECK(parse(HEAD "# a comment\nslot=B\nleft=3\nother=long text\nbegun=2\nfailed=A\n", &block));
    CHECK(is(&block, 'B', '3', '2', 'A'));
    CHECK(block_has(&block, "left=3") && block_has(&block, "begun=2") && !block_has(&block, "left=2"));
    CHECK(parse(HEAD "left=\n", &block) && is(&block, 'A', 0, 0, 0) && !block_has(&block, "left="));

    static const char *const lost[] = {"", "# GRUB Environment", HEAD "slot=C\n", HEAD "left=12\n", HEAD "failed=b\n"};
    for (size_t i = 0; i < sizeof lost / sizeof lost[0]; i++)
        CHECK(!parse(lost[i], &block));
    memset(text, 0, sizeof text);
    CHECK(!block_parse(text, &block));
    memset(text, '\n', sizeof text);
    CHECK(!block_parse(text, &block));

    block = (struct block){'B', '0', '3', 'B'};
    block_format(&block, text);
    CHECK(!memcmp(text, HEAD "slot=B\nleft=0\nbegun=3\nfailed=B\n###", 58));
    CHECK(block_parse(text, &block) && is(&block, 'B', '0', '3', 'B'));
    CHECK(text[BLOCK_SIZE - 1] == '#');
    return 0;
}
