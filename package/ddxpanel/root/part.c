/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "part.h"

#include <errno.h>
#include <grp.h>
#include <pwd.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#define HIDDEN (MS_NOSUID | MS_NODEV | MS_NOEXEC | MS_RDONLY)

/* In a mount namespace of its own, an empty file system on each of the folders. */
static int hide(const char *const *folders) {
    if (unshare(CLONE_NEWNS) || mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL))
        return -errno;
    for (; *folders; folders++)
        if (mount("none", *folders, "tmpfs", HIDDEN, "size=4k,mode=755") && errno != ENOENT)
            return -errno;
    return 0;
}

/* Give up root's rights, for good. Group and user last: before them it still needs the rights. */
static int give_up_rights(const struct part *part, const struct passwd *user) {
    gid_t group = part->group < 0 ? user->pw_gid : (gid_t)part->group;
    int error = hide(part->empty);

    if (error)
        return error;
    if (setgroups(0, NULL) || setresgid(group, group, group) || setresuid(user->pw_uid, user->pw_uid, user->pw_uid) ||
        prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) || prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0))
        return -errno;
    return 0;
}

_Noreturn static void part_run(const struct part *part, const struct passwd *user, pid_t parent) {
    signal(SIGTERM, SIG_DFL);
    int error = give_up_rights(part, user);
    if (!error && getppid() == parent)
        error = part->run(part->argument);
    fprintf(stderr, "ddxpanel: %s: %s\n", part->name, strerror(-error));
    _exit(1);
}

int part_start(const struct part *part) {
    const struct passwd *user = getpwnam(part->user);
    pid_t parent = getpid();

    if (!user || !user->pw_uid) /* a part never runs as root */
        return -ENOENT;
    pid_t process = fork();
    if (!process)
        part_run(part, user, parent);
    if (process < 0)
        return -errno;
    int fd = (int)syscall(SYS_pidfd_open, process, 0);
    return fd < 0 ? -errno : fd;
}
