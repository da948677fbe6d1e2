/* SPDX-License-Identifier: GPL-2.0-or-later */
/* A program connects to a store only if no user but the folder's owner, root or its own can have put it there. */
#include <errno.h>
#include <stdbool.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "store_process.h"

#define STRANGER 65534u

/* A folder in which programs look for a store; `path` is relative to the scratch folder. */
static char *folder(const char *path, mode_t mode, uid_t owner) {
    char *full = scratch_path(path);

    CHECK(!mkdir(full, 0700) || errno == EEXIST);
    CHECK_EQUAL(chown(full, owner, owner), 0);
    CHECK_EQUAL(chmod(full, mode), 0);
    return full;
}

/* Starts a process of this user that accepts connections there; returns its id once it listens. */
static pid_t listen_as(uid_t user, const char *path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int ready[2];
    char byte;

    CHECK_EQUAL(pipe(ready), 0);
    pid_t process = fork();
    CHECK(process >= 0);
    if (!process) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        CHECK(snprintf(address.sun_path, sizeof address.sun_path, "%s/store-2005", path) > 0);
        CHECK(!unlink(address.sun_path) || errno == ENOENT);
        int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
        mode_t before = umask(0);
        CHECK(!setgid(user) && !setuid(user) && !bind(fd, (struct sockaddr *)&address, sizeof address));
        umask(before);
        CHECK(!listen(fd, 8) && write(ready[1], "", 1) == 1);
        pause();
    }
    close(ready[1]);
    CHECK_EQUAL(read(ready[0], &byte, 1), 1);
    close(ready[0]);
    return process;
}

/* 0: the store there is trusted; else errno. */
static int asks(const char *path, uid_t user) {
    pid_t process = listen_as(user, path);

    CHECK_EQUAL(setenv("DDX_DIR", path, 1), 0);
    errno = 0;
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 0);
    int result = id ? 0 : errno;
    ddx_store_close(id);
    CHECK_EQUAL(kill(process, SIGKILL), 0);
    CHECK_EQUAL(waitpid(process, NULL, 0), process);
    return result;
}

static void test_clients(void) {
    char *common = folder("tmp", 01777, 0), *squatted = folder("tmp/ddx-0", 0755, STRANGER);
    char *mine = folder("tmp/mine", 01777, 0), *open = folder("open", 0777, 0);
    char *systems = folder("run", 0755, STRANGER), *link = scratch_path("tmp/link");

    CHECK_EQUAL(symlink(mine, link), 0);
    CHECK_EQUAL(asks(mine, 0), 0);
    CHECK_EQUAL(asks(mine, STRANGER), EPERM);     /* any user may make a socket there */
    CHECK_EQUAL(asks(squatted, STRANGER), EPERM); /* any user may have made the folder */
    CHECK_EQUAL(asks(squatted, 0), EPERM);
    CHECK_EQUAL(asks(open, 0), EPERM); /* any user may replace the socket */
    CHECK_EQUAL(asks(link, 0), EPERM);
    CHECK_EQUAL(asks(systems, STRANGER), 0); /* like /run/ddx, which belongs to the store's user */
    CHECK_EQUAL(asks(systems, 0), 0);
    free(common), free(squatted), free(mine), free(open), free(systems), free(link);
}

/* Nor does a store start where no program would trust it. */
static void test_store(void) {
    char *open = folder("open", 0777, 0);
    int status;

    CHECK_EQUAL(setenv("DDX_DIR", open, 1), 0);
    store_start("1M");
    for (int i = 0; waitpid(store_pid, &status, WNOHANG) != store_pid; i++) {
        CHECK(i < 1000);
        usleep(10000);
    }
    CHECK(WIFEXITED(status));
    CHECK_EQUAL(WEXITSTATUS(status), 1);
    free(open);
}

int main(void) {
    if (getuid())
        SKIP("processes of other users take root");
    store_folder_make();
    CHECK_EQUAL(chmod(scratch_folder, 0755), 0);
    test_clients();
    test_store();
    return 0;
}
