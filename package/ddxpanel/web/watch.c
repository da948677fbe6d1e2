/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "watch.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define PROGRAM "/usr/bin/ddxvideosnap"

struct picture *picture_hold(struct picture *picture) {
    picture->holders++;
    return picture;
}

void picture_drop(struct picture *picture) {
    if (picture && !--picture->holders)
        free(picture);
}

/* In the child. It gets standard input, output and errors, and no other descriptor: neither visitors nor root. */
_Noreturn static void become(const char *item, int input, int output) {
    static char path[] = "PATH=/usr/bin:/bin";
    char *const environment[] = {path, NULL};
    const char *const command[] = {PROGRAM, "-answer", "-name", item, NULL};

    signal(SIGPIPE, SIG_DFL);
    prctl(PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0);
    if (dup2(input, STDIN_FILENO) < 0 || dup2(output, STDOUT_FILENO) < 0 || close_range(3, ~0u, 0))
        _exit(1);
    execve(PROGRAM, (char *const *)command, environment); /* changes none of the words */
    _exit(1);
}

static bool start(struct watch *watch, const char *item) {
    int in[2], out[2];

    if (pipe2(in, O_CLOEXEC))
        return false;
    if (pipe2(out, O_CLOEXEC)) {
        close(in[0]);
        close(in[1]);
        return false;
    }
    pid_t process = fork();
    if (!process)
        become(item, in[0], out[1]);
    close(in[0]);
    close(out[1]);
    *watch = (struct watch){.process = process, .to = in[1], .from = out[0]};
    snprintf(watch->wanted.item, sizeof watch->wanted.item, "%s", item);
    if (process > 0 && fcntl(watch->from, F_SETFL, O_NONBLOCK) >= 0 && fcntl(watch->to, F_SETFL, O_NONBLOCK) >= 0)
        return true;
    watch_close(watch);
    return false;
}

struct watch *watch_find(struct watch watches[WATCHES], const char *item) {
    for (struct watch *watch = watches; watch < watches + WATCHES; watch++)
        if (watch->process && !strcmp(watch->wanted.item, item))
            return watch;
    return NULL;
}

struct watch *watch_open(struct watch watches[WATCHES], const char *item, int64_t now, const char **reason) {
    struct watch *watch = watch_find(watches, item);

    for (struct watch *free = watches; !watch && free < watches + WATCHES; free++) {
        if (free->process)
            continue;
        if (!start(free, item)) {
            *reason = strerror(errno);
            return NULL;
        }
        watch = free;
    }
    if (watch)
        watch->used = now;
    else
        *reason = "three items are being watched already";
    return watch;
}

bool watch_ask(struct watch *watch, const struct picture_wanted *wanted, int64_t now) {
    char line[64];
    int size =
        snprintf(line, sizeof line, "%" PRIu64 " %d %d\n", wanted->after, wanted->form.quality, wanted->form.divisor);

    watch->wanted = *wanted;
    watch->since = now;
    watch->asked = true;
    return write(watch->to, line, (size_t)size) == size; /* SIGPIPE is ignored */
}

static bool refuse(struct picture_said *said, const char *reason) {
    *said = (struct picture_said){.kind = PICTURE_REFUSED, .reason = reason};
    return true;
}

/* The beginning of an answer; what came after its line is the beginning of the picture. True: it is complete. */
static bool begin(struct watch *watch, struct picture_said *said) {
    char *feed = memchr(watch->line, '\n', watch->line_size);

    if (!feed)
        return watch->line_size == sizeof watch->line && refuse(said, "ddxvideosnap talks nonsense");
    *feed = 0;
    size_t rest = watch->line_size - (size_t)(feed + 1 - watch->line);
    if (!picture_hear(said, watch->line) || (said->kind != PICTURE_TOO_LARGE && rest > said->size))
        return refuse(said, "ddxvideosnap talks nonsense");
    watch->line_size = 0;
    if (said->kind != PICTURE_NEW)
        return true;
    watch->picture = malloc(sizeof *watch->picture + said->size);
    if (!watch->picture)
        return refuse(said, "there is no memory for it");
    *watch->picture = (struct picture){.holders = 1, .said = *said};
    memcpy(watch->picture->bytes, feed + 1, rest);
    watch->got = rest;
    return rest == said->size;
}

bool watch_hear(struct watch *watch, struct picture_said *said, struct picture **picture) {
    struct picture *coming = watch->picture;
    char *to = coming ? (char *)coming->bytes + watch->got : watch->line + watch->line_size;
    size_t room = coming ? coming->said.size - watch->got : sizeof watch->line - watch->line_size;
    ssize_t size = read(watch->from, to, room);

    *picture = NULL;
    if (size < 0 && (errno == EAGAIN || errno == EINTR))
        return false;
    if (size <= 0 || !watch->asked)
        return refuse(said, "ddxvideosnap has exited");
    bool complete;
    if (coming) {
        watch->got += (size_t)size;
        complete = watch->got == coming->said.size;
    } else {
        watch->line_size += (size_t)size;
        complete = begin(watch, said);
    }
    if (!complete)
        return false;
    watch->asked = false;
    if (watch->picture) {
        *picture = watch->picture;
        *said = watch->picture->said;
        watch->picture = NULL;
    }
    return true;
}

void watch_close(struct watch *watch) {
    close(watch->to);
    close(watch->from);
    if (watch->process > 0) {
        kill(watch->process, SIGKILL); /* not reaped yet, so the number is still its own */
        while (waitpid(watch->process, NULL, 0) < 0 && errno == EINTR)
            continue;
    }
    picture_drop(watch->picture);
    *watch = (struct watch){.process = 0};
}
