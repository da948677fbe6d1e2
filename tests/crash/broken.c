/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The same test against a protocol that is broken on purpose: it must fail, and for that reason. */
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "director.h"
#include "tests.h"

static void must_fail(const char *way, const char *complaint) {
    char said[4096] = "";
    size_t length = 0;
    ssize_t got;
    int ends[2], status;

    if (pipe(ends))
        fail("no pipe");
    pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        dup2(ends[1], 2);
        setenv("DDX_BROKEN", way, 1);
        setenv("DDX_CRASH_HANG", "2", 1);
        execl("/proc/self/exe", "crash", "random", "200", "1", (char *)NULL);
        _exit(127);
    }
    close(ends[1]);
    while (length < sizeof said - 1 && (got = read(ends[0], said + length, sizeof said - 1 - length)) > 0) {
        length += (size_t)got;
        char *complains = strstr(said, "\n  ");
        if (!complains && length > sizeof said / 2) { /* what the store says */
            memmove(said, said + length / 2, length - length / 2 + 1);
            length -= length / 2;
        }
    }
    waitpid(pid, &status, 0);
    close(ends[0]);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 1 || !strstr(said, complaint))
        fail("%s: ended with %x, without \"%s\": %s", way, (unsigned)status, complaint, said);
    printf("%s: noticed: %s\n", way, complaint);
}

int test_broken(void) {
    must_fail("blind", "torn: ");
    must_fail("miscount", "were counted");
    must_fail("deaf", "nobody takes over");
    return 0;
}
