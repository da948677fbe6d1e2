/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The store's log is not read, and its pipe is full: the store omits lines, and reports their number later. */
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <unistd.h>

#include "puppet.h"
#include "tests.h"

/* Reads all available text. */
static void read_log(int fd, char *text, size_t bytes) {
    size_t length = 0;
    ssize_t got;

    while (length + 1 < bytes && (got = read(fd, text + length, bytes - length - 1)) > 0)
        length += (size_t)got;
    text[length] = 0;
}

int test_mute(void) {
    static char filling[1 << 16], text[1 << 16];
    struct ddx_item_info info;
    int ends[2];

    if (pipe2(ends, O_CLOEXEC | O_NONBLOCK) || fcntl(ends[1], F_SETPIPE_SZ, 4096) < 0)
        fail("no pipe");
    /* The store's end must not be O_NONBLOCK: others share the open file, as with a log service. */
    fcntl(ends[1], F_SETFL, 0);
    store_log = ends[1];
    store_begin(NULL);
    struct puppet *writer = puppet_begin(NULL), *next = puppet_begin(NULL);
    ASK(writer, WRITE, 1, 1);
    fcntl(ends[1], F_SETFL, O_NONBLOCK);
    while (write(ends[1], filling, 1) == 1)
        continue;
    fcntl(ends[1], F_SETFL, 0);
    puppet_kill(writer); /* the store would log this */
    AWAIT(read_info(&info) && !info.writer_pid, "the store does not notice");
    ASK(next, WRITE, 1, 2); /* and this */
    read_log(ends[0], text, sizeof text);
    ASK(next, DONE, 0, 0);
    AWAIT(read_info(&info) && !info.writer_pid, "the store does not notice");
    read_log(ends[0], text, sizeof text);
    if (!strstr(text, " lines were left out"))
        fail("the log does not say what is left out: %s", text);
    puppets_end();
    store_log = -1;
    return 0;
}
