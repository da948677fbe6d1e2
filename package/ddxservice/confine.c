/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * confine CAPABILITY[,CAPABILITY...] PROGRAM ...: run a program as root, but with only these capabilities (to set
 * addresses, or the time), also for its children. (BusyBox's setpriv cannot reduce the bounding set.)
 */
#include <errno.h>
#include <linux/capability.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#define REFUSED 111 /* as runsv does: the program was not started */

static const struct {
    const char *name;
    int number;
} known[] = {
    {"net_admin", CAP_NET_ADMIN},
    {"net_bind_service", CAP_NET_BIND_SERVICE},
    {"net_raw", CAP_NET_RAW},
    {"sys_time", CAP_SYS_TIME},
};

/* One bit for each name; 0 if a name is unknown. */
static unsigned long long parse(char *names) {
    unsigned long long kept = 0;

    for (char *name = strtok(names, ","); name; name = strtok(NULL, ",")) {
        size_t i = 0;

        while (i < sizeof known / sizeof *known && strcmp(known[i].name, name) != 0)
            i++;
        if (i == sizeof known / sizeof *known)
            return 0;
        kept |= 1ULL << known[i].number;
    }
    return kept;
}

int main(int argc, char **argv) {
    unsigned long long kept = argc > 2 ? parse(argv[1]) : 0;

    if (!kept) {
        fprintf(stderr, "usage: confine net_admin|net_bind_service|net_raw|sys_time[,...] PROGRAM ...\n");
        return 2;
    }
    /* All capabilities of this kernel. At exec, a program of root gets those that are left in this set. */
    for (int number = 0; prctl(PR_CAPBSET_READ, number, 0, 0, 0) >= 0; number++)
        if (!(kept >> number & 1) && prctl(PR_CAPBSET_DROP, number, 0, 0, 0)) {
            fprintf(stderr, "confine: capability %d cannot be dropped: %s\n", number, strerror(errno));
            return REFUSED;
        }
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)) {
        fprintf(stderr, "confine: %s\n", strerror(errno));
        return REFUSED;
    }
    execvp(argv[2], argv + 2);
    fprintf(stderr, "confine: %s: %s\n", argv[2], strerror(errno));
    return REFUSED;
}
