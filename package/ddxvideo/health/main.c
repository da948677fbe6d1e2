/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Kills programs that hang, so that runsv starts them again, and feeds the watchdog as long as that is sufficient.
 * Reports the first frame to the boot's later work.
 */
#include <ddx.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "ddx_stats.h"
#include "ddx_time.h"
#include "program.h"

struct hw_watchdog {
    const char *path;
    int file;    /* -1: not open */
    int timeout; /* seconds, as set in the hardware */
};

#define WATCH_STORE "ddxstore" /* the name of the store's service */
#define WATCH_MAX 32           /* services */

struct watched {
    char name[DDX_NAME_MAX + 1];
    int32_t pid;    /* 0: not running */
    bool down;      /* it is disabled */
    uint64_t signs; /* number of the item's last value */
    bool began;     /* a value has come from this pid; before it, silence means nothing */
    int64_t silent; /* ns since the last value */
    unsigned kills; /* of this pid; more than one if the first one had no effect */
    bool seen;      /* in the folder, at this check */
};

struct liveness {
    struct watched service[WATCH_MAX];
    unsigned count;
    bool answered;   /* the store has, at the last check */
    int64_t refused; /* ns of waiting for the store since its last answer */
};

/* ---- The hardware watchdog ---- */

/* The hardware watchdog: it resets the machine unless it is fed. It cannot be stopped once it is open. */

/* Open it. If it is missing, try again: its driver may be loaded later. 0 if it is open, otherwise -errno. */
static int hw_watchdog_open(struct hw_watchdog *watchdog, int timeout) {
    if (watchdog->file >= 0)
        return 0;
    watchdog->file = open(watchdog->path, O_WRONLY | O_CLOEXEC);
    if (watchdog->file < 0)
        return -errno;
    watchdog->timeout = timeout;
    /* Some hardware has a fixed time, which it reports. */
    if (ioctl(watchdog->file, WDIOC_SETTIMEOUT, &watchdog->timeout))
        ioctl(watchdog->file, WDIOC_GETTIMEOUT, &watchdog->timeout);
    return 0;
}

static void hw_watchdog_feed(const struct hw_watchdog *watchdog) {
    if (watchdog->file >= 0)
        ioctl(watchdog->file, WDIOC_KEEPALIVE, 0);
}

/* ---- Which services are alive ---- */

/*
 * Finds out which services are alive. runsv knows which of them run (/run/service/<name>/supervise). A program is alive
 * if it writes its item `<name>.stats`, as each program does once a second; the store is alive if it answers.
 *
 * Silence is counted in this program's own running time, from check to check: if the machine, or the host of a virtual
 * machine, stops all programs, none of them counts as dead.
 */

#define SUFFIX ".stats"
#define LOOK_MAX_NS INT64_C(2000000000) /* that count at most between two checks */

/* The service of this name, or NULL. */
static struct watched *liveness_find(const struct liveness *liveness, const char *name) {
    for (unsigned i = 0; i < liveness->count; i++)
        if (!strcmp(liveness->service[i].name, name))
            return (struct watched *)(uintptr_t)&liveness->service[i];
    return NULL;
}

static bool path_of(char *path, size_t size, const char *folder, const char *name, const char *file) {
    return snprintf(path, size, "%s/%s/%s", folder, name, file) < (int)size;
}

/* The process that runsv runs; 0 if there is none, or no runsv for the folder yet. */
static int32_t read_pid(const char *folder, const char *name) {
    char path[256];
    int pid = 0;
    FILE *file = path_of(path, sizeof path, folder, name, "supervise/pid") ? fopen(path, "re") : NULL;

    if (!file)
        return 0;
    if (fscanf(file, "%d", &pid) != 1)
        pid = 0;
    fclose(file);
    return pid;
}

static void look_at(struct liveness *liveness, const char *folder, const char *name) {
    char path[256];
    struct watched *service = liveness_find(liveness, name);

    if (!service) {
        if (liveness->count == WATCH_MAX || strlen(name) > DDX_NAME_MAX - strlen(SUFFIX))
            return;
        service = &liveness->service[liveness->count++];
        *service = (struct watched){.pid = 0};
        strcpy(service->name, name);
    }
    service->seen = true;
    service->down = path_of(path, sizeof path, folder, name, "down") && !access(path, F_OK);
    int32_t pid = read_pid(folder, name);
    if (pid != service->pid) {
        service->pid = pid;
        service->began = false;
        service->silent = 0;
        service->kills = 0;
        if (!strcmp(name, WATCH_STORE))
            liveness->refused = 0;
    }
}

static void look_at_folder(struct liveness *liveness, const char *folder) {
    for (unsigned i = 0; i < liveness->count; i++)
        liveness->service[i].seen = false;
    DIR *list = opendir(folder);
    if (!list)
        return;
    for (const struct dirent *entry; (entry = readdir(list)) != NULL;)
        if (*entry->d_name != '.')
            look_at(liveness, folder, entry->d_name);
    closedir(list);
    for (unsigned i = liveness->count; i-- > 0;)
        if (!liveness->service[i].seen)
            liveness->service[i] = liveness->service[--liveness->count];
}

/* Length of the instance's name in the name of its counters' item; 0: the item is another one, or another machine's. */
static size_t instance_of(const struct ddx_item_info *item) {
    size_t length = strlen(item->name), suffix = strlen(SUFFIX);
    bool is_own = length > suffix && !strcmp(item->name + length - suffix, SUFFIX) && !strchr(item->name, ':');

    return is_own ? length - suffix : 0;
}

static void note_sign(struct liveness *liveness, const struct ddx_item_info *item) {
    char name[DDX_NAME_MAX + 1];
    size_t length = instance_of(item);

    if (!length)
        return;
    memcpy(name, item->name, length);
    name[length] = 0;
    struct watched *service = liveness_find(liveness, name);
    /* A value of its previous process is no sign of life. */
    if (!service || !service->pid || item->writer_pid != service->pid || item->sequence == service->signs)
        return;
    service->signs = item->sequence;
    service->began = true;
    service->silent = 0;
}

/* ---- The first frame ---- */

/* 1 if these counters report a frame, 0 if they report none, or -errno. */
static int has_frame(DDX_STORE_ID *id, const char *name) {
    static DDX_STATS stats;
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);

    if (!item)
        return errno == ENOENT ? 0 : -errno; /* dropped since the list was made */
    int result = -ETIMEDOUT;                 /* no value yet */
    if (!strcmp(ddx_store_item_type(item), "DDX_STATS"))
        result = ddx_store_read(item, &stats, NULL, 0, DDX_CURRENT);
    ddx_store_done_item(item);
    if (!result)
        return stats.first != 0;
    return result == -ETIMEDOUT ? 0 : result;
}

/*
 * Write a line feed into the pipe once a program has its first frame. While nothing reads the pipe, no counters are
 * read. If the store does not answer, the next check tries again: the watchdog must be fed meanwhile.
 */
static void report_first_frame(DDX_STORE_ID *id, const struct ddx_item_info *items, unsigned count, const char *pipe) {
    int found = 0, file = open(pipe, O_WRONLY | O_NONBLOCK | O_CLOEXEC);

    if (file < 0)
        return;
    for (unsigned i = 0; i < count && !found; i++)
        if (instance_of(&items[i]))
            found = has_frame(id, items[i].name);
    if (found > 0 && write(file, "\n", 1) != 1)
        say("%s: %s", pipe, strerror(errno));
    close(file);
}

/* Check all services in `folder`, and the items of the store; report the first frame to `pipe`. Waits at most 5 s for
 * each answer. */
static void liveness_look(struct liveness *liveness, const char *folder, const char *pipe, DDX_STORE_ID *id) {
    static int64_t last;
    struct ddx_item_info *items;
    unsigned count;

    look_at_folder(liveness, folder);
    int64_t begin = ddx_time_now(), passed = last ? begin - last : 0;
    last = begin;
    liveness->answered = !ddx_store_list(id, NULL, &items, &count);
    if (!liveness->answered) {
        /* No other program can be checked now. A missing store refuses at once, a hanging store blocks. */
        liveness->refused += ddx_time_now() - begin;
        return;
    }
    liveness->refused = 0;
    for (unsigned i = 0; i < liveness->count; i++)
        liveness->service[i].silent += passed < LOOK_MAX_NS ? passed : LOOK_MAX_NS;
    for (unsigned i = 0; i < count; i++)
        note_sign(liveness, &items[i]);
    report_first_frame(id, items, count, pipe);
    free(items);
}

/* Whether it should run and does, but has been silent for `limit` ns. */
static bool liveness_is_silent(const struct liveness *liveness, const struct watched *service, int64_t limit) {
    if (!service->pid || service->down)
        return false;
    if (!strcmp(service->name, WATCH_STORE))
        return liveness->refused >= limit;
    return service->began && service->silent >= limit;
}

/* Let runsv kill it and start it again; counts the kill. 0 or -errno. */
static int liveness_kill(struct watched *service, const char *folder) {
    char path[256];

    if (!path_of(path, sizeof path, folder, service->name, "supervise/control"))
        return -ENAMETOOLONG;
    int file = open(path, O_WRONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0)
        return -errno;
    int result = write(file, "k", 1) == 1 ? 0 : -errno;
    close(file);
    service->kills++;
    return result;
}

/* ---- Program ---- */

#define UNANSWERED 4 /* s of waiting for the store; a request gives up after five */
#define RECORDER "ddxvideosave"
#define AGAIN_NS (5 * SECOND) /* until a kill without effect is repeated */

static const char *folder = "/run/service", *device = "/dev/watchdog", *late = "/run/late";
static long silence = 6, timeout = 30;

static int64_t limit_of(const struct watched *service) {
    return (strcmp(service->name, WATCH_STORE) != 0 ? silence : UNANSWERED) * SECOND;
}

static void kill_silent(struct liveness *liveness) {
    for (unsigned i = 0; i < liveness->count; i++) {
        struct watched *service = &liveness->service[i];

        if (!liveness_is_silent(liveness, service, limit_of(service) + service->kills * AGAIN_NS))
            continue;
        int error = liveness_kill(service, folder);
        if (error)
            say("%s: no sign of life, and it cannot be killed: %s", service->name, strerror(-error));
        else
            say("%s: no sign of life from process %d, %s", service->name, (int)service->pid,
                service->kills == 1 ? "killed" : "killed again");
    }
}

/*
 * Whether the store answers, and the recorder, if there is one, is alive. Other programs do not count: a reset does not
 * cure a program that exits again and again, and the rest of the robot works without it.
 */
static bool all_well(const struct liveness *liveness) {
    const struct watched *recorder = liveness_find(liveness, RECORDER);

    return liveness->answered && !(recorder && liveness_is_silent(liveness, recorder, limit_of(recorder)));
}

static void guard(struct hw_watchdog *watchdog, bool well) {
    static bool told_absent, hungry;

    if (watchdog->file < 0) {
        int error = hw_watchdog_open(watchdog, (int)timeout);

        if (!error)
            say("%s: resets the machine after %d s without food", watchdog->path, watchdog->timeout);
        else if (!told_absent)
            say("%s: %s; a machine that hangs will not be reset", watchdog->path, strerror(-error));
        told_absent = true;
    }
    if (well)
        hw_watchdog_feed(watchdog);
    if (well == hungry)
        say(well ? "all is well again" : "the watchdog is not fed until store and recorder respond");
    hungry = !well;
}

int main(int argc, char **argv) {
    const struct option_entry options[] = {
        {"silence", "SECONDS", "kill a program after this long without a sign of life (default: 6)", OPTION_NUMBER,
         &silence, 3, 600},
        {"watchdog", "DEVICE", "the hardware watchdog (default: /dev/watchdog)", OPTION_TEXT, &device, 0, 0},
        {"timeout", "SECONDS", "of the watchdog, until it resets the machine (default: 30)", OPTION_NUMBER, &timeout,
         20, 600},
        {"services", "FOLDER", "folder of runsvdir (default: /run/service)", OPTION_TEXT, &folder, 0, 0},
        {"late", "PIPE", "gets a line feed once a program has its first frame (default: /run/late)", OPTION_TEXT, &late,
         0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };
    struct program program = {.name = "ddxhealth",
                              .purpose = "Supervises the services: a program that hangs is killed and started again;\n"
                                         "when that does not help the store or the recorder, the watchdog resets the\n"
                                         "machine. It does so as well when this program ends.",
                              .options = options,
                              .brief = true};

    program_start(&program, argc, argv);
    if (program.check)
        return EXIT_OK;
    static struct liveness liveness;
    struct hw_watchdog watchdog = {.path = device, .file = -1};
    DDX_STORE_ID *id = NULL;
    guard(&watchdog, true);
    while (!program_stopping()) {
        if (!id)
            id = ddx_store_open(NULL, (int)program.port, 0);
        if (id) {
            liveness_look(&liveness, folder, late, id);
            kill_silent(&liveness);
        }
        guard(&watchdog, all_well(&liveness));
        nanosleep(&(struct timespec){.tv_sec = 1}, NULL); /* a signal ends it */
    }
    ddx_store_close(id);
    return EXIT_OK;
}
