/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * What the store's workers keep: each finds the heap as the one before committed it last, at the same addresses,
 * whatever that one did afterwards.
 */
#include "../../package/ddx/store/kept.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

#define PIECES 1000
#define LARGEST 5000

struct root {
    unsigned generation;
    unsigned char *piece[PIECES];
    size_t bytes[PIECES];
};

static unsigned char content(unsigned generation, unsigned i) {
    return (unsigned char)(generation * 31 + i);
}

static void fill(struct root *root, unsigned i) {
    root->bytes[i] = 1 + (root->generation * 7919 + i * 104729) % LARGEST;
    root->piece[i] = kept_allocate(root->bytes[i]);
    CHECK(root->piece[i]);
    for (size_t k = 0; k < root->bytes[i]; k++)
        CHECK_EQUAL(root->piece[i][k], 0);
    memset(root->piece[i], content(root->generation, i), root->bytes[i]);
}

/* Every worker gives half of its pieces back and takes others; and what it does after its commit is never found. */
static void work(unsigned generation) {
    bool before = kept_restore();
    struct root *root = before ? kept_root() : kept_allocate(sizeof *root);

    CHECK_EQUAL(before, generation > 0);
    CHECK(root && root == kept_root());
    CHECK_EQUAL(root->generation, generation);
    root->generation++;
    for (unsigned i = 0; i < PIECES; i++) {
        for (size_t k = 0; k < root->bytes[i] && before; k++)
            CHECK_EQUAL(root->piece[i][k], *root->piece[i]);
        if (before && i % 2 == generation % 2) /* the last worker made this one */
            CHECK_EQUAL(*root->piece[i], content(generation, i));
        if (!before || i % 2 != generation % 2) {
            kept_free(root->piece[i]);
            fill(root, i);
        }
    }
    kept_commit();
    root->generation = 77;
    for (unsigned i = 0; i < PIECES; i++) {
        memset(root->piece[i], 0xaa, root->bytes[i]);
        kept_free(root->piece[i]);
    }
    CHECK(!kept_allocate(SIZE_MAX / 2));
    while (kept_allocate(1 << 20)) /* all that there is */
        continue;
    _exit(0);
}

int main(void) {
    CHECK_EQUAL(kept_begin(), 0);
    for (unsigned generation = 0; generation < 20; generation++) {
        int status;
        pid_t pid = fork();

        CHECK(pid >= 0);
        if (pid == 0)
            work(generation);
        CHECK_EQUAL(waitpid(pid, &status, 0), pid);
        CHECK_EQUAL(status, 0);
    }
    return 0;
}
