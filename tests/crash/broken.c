/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The same test against a protocol that is broken on purpose: it must fail, and for that reason. */
#include <stdbool.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "director.h"
#include "tests.h"

#define ATTEMPTS 3 /* where a fault shows only if parties meet at the wrong moment, and a busy machine lets them miss */

/* All that comes out of a pipe, as a text; the caller's. */
static char *read_all(int fd) {
    size_t length = 0, room = 1 << 16;
    char *text = malloc(room);
    ssize_t got;

    while (text && (got = read(fd, text + length, room - length - 1)) > 0) {
        length += (size_t)got;
        if (length + 1 == room)
            text = realloc(text, room *= 2);
    }
    if (!text)
        fail("no memory");
    text[length] = 0;
    return text;
}

/* Whether the test fails, for that reason; *said is all that it said, the caller's. */
static bool fails(const char *test, const char *way, const char *complaint, char **said) {
    int ends[2], status;

    if (pipe(ends))
        fail("no pipe");
    pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        dup2(ends[1], 2);
        setenv("DDX_BROKEN", way, 1);
        if (!strcmp(test, "random"))
            execl("/proc/self/exe", "crash", test, "200", "1", (char *)NULL);
        execl("/proc/self/exe", "crash", test, (char *)NULL);
        _exit(127);
    }
    close(ends[1]);
    *said = read_all(ends[0]);
    waitpid(pid, &status, 0);
    close(ends[0]);
    return WIFEXITED(status) && WEXITSTATUS(status) == 1 && strstr(*said, complaint);
}

static void must_fail(const char *test, const char *way, const char *complaint) {
    char *said;
    int attempts = 1;
    while (!fails(test, way, complaint, &said)) {
        fputs(said, stderr);
        if (attempts++ == ATTEMPTS)
            fail("%s: ended without \"%s\", see above", way, complaint);
        free(said);
    }
    free(said);
    printf("%s: noticed: %s\n", way, complaint);
}

int test_broken(void) {
    must_fail("random", "blind", "torn: ");
    must_fail("random", "miscount", "were counted");
    must_fail("random", "deaf", "nobody takes over");
    must_fail("restart", "numbers", "a party complains");
    must_fail("pins", "unheard", "the reader does not ask");
    must_fail("restart", "half", "a party complains");
    must_fail("epochs", "hasty", "NEXT gives");
    must_fail("retired", "uncounted", "bytes of memory files exist");
    must_fail("retired", "pile", "keeps what it has not read");
    must_fail("stop", "patient", "a reader that holds a frame is stopped: ");
    return 0;
}
