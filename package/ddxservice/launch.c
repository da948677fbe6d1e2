/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * launch: starts a service's program, as the file `launch` in the current folder says. `run` and `log/run` of each
 * service folder are links to it, instead of generated scripts: a shell, and each program that it runs, takes time at
 * a boot, and no shell reads values of settings. Linked statically for the same reason.
 *     launch FILE ARGUMENT...    the same with another file and further arguments, at once: `service check`
 * The file has lines of key=value, each key but `argument` once at most, in any order:
 *     user=NAME  group=NAME (without: the user's)  nice=NUMBER  realtime=PRIORITY (FIFO)  oom_score_adj=NUMBER
 *     memory_limit=BYTES (of what the program allocates)  mounted=FOLDER (waits until a file system is mounted there)
 *     argument=TEXT for each word of the command, the first one a path below /
 * and at last `end`: a file without it was cut. If anything is wrong, one line says what, and nothing is started.
 */
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <limits.h>
#include <pwd.h>
#include <sched.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#define REFUSED 111 /* as runsv does: the program was not started */
#define LARGEST 65536
#define MOST_WORDS 256

enum key { USER, GROUP, NICE, REALTIME, OOM_SCORE_ADJ, MEMORY_LIMIT, MOUNTED, KEYS };

/* With the range of its number; none: text. */
static const struct {
    const char *name;
    long long least, most;
} known[KEYS] = {
    [USER] = {"user", 0, 0},
    [GROUP] = {"group", 0, 0},
    [NICE] = {"nice", -20, 19},
    [REALTIME] = {"realtime", 1, 99},
    [OOM_SCORE_ADJ] = {"oom_score_adj", -1000, 1000},
    [MEMORY_LIMIT] = {"memory_limit", 1, LONG_MAX},
    [MOUNTED] = {"mounted", 0, 0},
};

struct plan {
    const char *file;
    char *text[KEYS]; /* NULL: not set */
    long long number[KEYS];
    uid_t user;
    gid_t group;
    char *words[MOST_WORDS + 1];
    size_t count;
};

/* Prints the reason, with the meaning of `error` unless it is 0. */
static _Noreturn void refuse(const struct plan *plan, const char *what, const char *value, int error) {
    fprintf(stderr, "launch: %s: %s%s%s%s%s; nothing is started\n", plan->file, what, value ? " " : "",
            value ? value : "", error ? ": " : "", error ? strerror(error) : "");
    exit(REFUSED);
}

static void add_word(struct plan *plan, char *word) {
    if (plan->count == MOST_WORDS)
        refuse(plan, "too many arguments", NULL, 0);
    plan->words[plan->count++] = word;
}

static void set_key(struct plan *plan, enum key key, char *value) {
    if (plan->text[key])
        refuse(plan, "is contradictory: twice", known[key].name, 0);
    plan->text[key] = value;
    if (known[key].least == known[key].most) {
        if (!*value)
            refuse(plan, "has no value for", known[key].name, 0);
        return;
    }
    char *rest;

    errno = 0;
    plan->number[key] = strtoll(value, &rest, 10);
    if (errno || *rest || rest == value || plan->number[key] < known[key].least || plan->number[key] > known[key].most)
        refuse(plan, "has an invalid number for", known[key].name, 0);
}

static void take_line(struct plan *plan, char *line) {
    char *value = strchr(line, '=');

    if (!value)
        refuse(plan, "is not key=value:", line, 0);
    *value++ = '\0';
    if (strcmp(line, "argument") == 0) {
        add_word(plan, value);
        return;
    }
    for (int key = 0; key < KEYS; key++)
        if (strcmp(line, known[key].name) == 0) {
            set_key(plan, key, value);
            return;
        }
    refuse(plan, "has an unknown key", line, 0);
}

static void parse(struct plan *plan, char *text) {
    char *line = text;

    for (char *stop; (stop = strchr(line, '\n')); line = stop + 1) {
        *stop = '\0';
        if (strcmp(line, "end") != 0) {
            take_line(plan, line);
            continue;
        }
        if (stop[1])
            refuse(plan, "goes on after end", NULL, 0);
        if (!plan->text[USER])
            refuse(plan, "has no user", NULL, 0);
        if (plan->count == 0 || plan->words[0][0] != '/')
            refuse(plan, "has no path of a program", NULL, 0);
        return;
    }
    refuse(plan, "is cut: it has no end", NULL, 0);
}

/* The whole file, with a final zero. */
static char *read_file(const struct plan *plan) {
    static char text[LARGEST + 1];
    size_t size = 0;
    ssize_t got;
    int fd = open(plan->file, O_RDONLY | O_CLOEXEC);

    if (fd < 0)
        refuse(plan, "cannot be read", NULL, errno);
    while ((got = read(fd, text + size, LARGEST - size)) > 0)
        size += (size_t)got;
    if (got < 0)
        refuse(plan, "cannot be read", NULL, errno);
    close(fd);
    if (size == LARGEST || memchr(text, '\0', size))
        refuse(plan, "is too long, or no text", NULL, 0);
    return text;
}

/* From the files themselves: a static program has no other source of users. */
static void find_user(struct plan *plan) {
    FILE *file = fopen("/etc/passwd", "re");
    const struct passwd *user = NULL;

    while (file && (user = fgetpwent(file)) && strcmp(user->pw_name, plan->text[USER]) != 0)
        ;
    if (!user)
        refuse(plan, "there is no user", plan->text[USER], 0);
    plan->user = user->pw_uid;
    plan->group = user->pw_gid;
    fclose(file);
    if (!plan->text[GROUP])
        return;
    const struct group *group = NULL;

    file = fopen("/etc/group", "re");
    while (file && (group = fgetgrent(file)) && strcmp(group->gr_name, plan->text[GROUP]) != 0)
        ;
    if (!group)
        refuse(plan, "there is no group", plan->text[GROUP], 0);
    plan->group = group->gr_gid;
    fclose(file);
}

/* 0, or the error. */
static int write_file(const char *name, const char *text, size_t size) {
    int fd = open(name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    ssize_t written;
    int error;

    if (fd < 0)
        return errno;
    written = write(fd, text, size);
    error = written < 0 ? errno : written != (ssize_t)size ? EIO : 0;
    close(fd);
    return error;
}

/* When the program began: `finish` delays the next start by it. A failure stops nothing, since /run may be full. */
static void note_begin(void) {
    char text[64];
    int fd = open("/proc/uptime", O_RDONLY | O_CLOEXEC);
    ssize_t size;

    if (fd < 0)
        return;
    size = read(fd, text, sizeof text);
    if (size > 0)
        (void)write_file("begin", text, (size_t)size);
    close(fd);
}

static bool is_mounted(const char *folder) {
    struct stat here, above;
    char parent[PATH_MAX];

    if (snprintf(parent, sizeof parent, "%s/..", folder) >= (int)sizeof parent)
        return false;
    return stat(folder, &here) == 0 && S_ISDIR(here.st_mode) && stat(parent, &above) == 0 &&
           (here.st_dev != above.st_dev || here.st_ino == above.st_ino);
}

/* The file `waiting` shows it. A stop of the service ends this process. */
static void wait_for_mount(const char *folder) {
    if (!is_mounted(folder)) {
        printf("waits until there is a disk at %s\n", folder);
        fflush(stdout);
        (void)write_file("waiting", "", 0);
        while (!is_mounted(folder))
            usleep(500000);
    }
    unlink("waiting");
}

/* Not refused: a container may forbid it, and a program without it is better than none. */
static void set_oom_score(const struct plan *plan) {
    const char *score = plan->text[OOM_SCORE_ADJ] ? plan->text[OOM_SCORE_ADJ] : "0";
    int error = write_file("/proc/self/oom_score_adj", score, strlen(score));

    if (error)
        fprintf(stderr, "launch: %s: oom_score_adj %s: %s; started without\n", plan->file, score, strerror(error));
}

/* All that root alone may do, then the user. */
static void become(const struct plan *plan) {
    if (plan->text[REALTIME]) {
        struct sched_param priority = {.sched_priority = (int)plan->number[REALTIME]};

        if (sched_setscheduler(0, SCHED_FIFO, &priority))
            refuse(plan, "realtime", plan->text[REALTIME], errno);
    }
    if (plan->text[NICE] && setpriority(PRIO_PROCESS, 0, (int)plan->number[NICE]))
        refuse(plan, "nice", plan->text[NICE], errno);
    if (plan->text[MEMORY_LIMIT]) {
        struct rlimit limit;

        if (getrlimit(RLIMIT_DATA, &limit))
            refuse(plan, "memory_limit", plan->text[MEMORY_LIMIT], errno);
        limit.rlim_cur = (rlim_t)plan->number[MEMORY_LIMIT];
        if (setrlimit(RLIMIT_DATA, &limit))
            refuse(plan, "memory_limit", plan->text[MEMORY_LIMIT], errno);
    }
    if (setgroups(1, &plan->group) || setgid(plan->group))
        refuse(plan, "group", plan->text[GROUP] ? plan->text[GROUP] : "of the user", errno);
    if (setuid(plan->user))
        refuse(plan, "user", plan->text[USER], errno);
    /* No further privileges, not even from a program with the set-user-ID bit. */
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
        refuse(plan, "no-new-privileges", NULL, errno);
}

int main(int argc, char **argv) {
    bool is_run = argc < 2;
    struct plan plan = {.file = is_run ? "launch" : argv[1]};

    if (is_run)
        dup2(STDOUT_FILENO, STDERR_FILENO);
    parse(&plan, read_file(&plan));
    for (int i = 2; i < argc; i++)
        add_word(&plan, argv[i]);
    find_user(&plan);
    if (is_run) {
        if (plan.text[MOUNTED])
            wait_for_mount(plan.text[MOUNTED]);
        note_begin();
        set_oom_score(&plan);
    }
    become(&plan);
    execv(plan.words[0], plan.words);
    refuse(&plan, plan.words[0], NULL, errno);
}
