/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "director.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include "../scratch.h"
#include "../unit/check.h"
#include "../worker_of.h"

struct party party[ACTORS];
pid_t store_process;
unsigned store_descriptors;
const char *store_budget = "64M";
int store_log = -1;
static int64_t longest_wait;

void fail(const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    for (unsigned i = 0; i < ACTORS; i++)
        if (party[i].pid)
            fprintf(stderr, "  %c%u pid %d: %llu turns, %llu frames, last %llu of term %llu%s%s\n", party[i].kind, i,
                    (int)party[i].pid, (unsigned long long)stage->actor[i].beats,
                    (unsigned long long)stage->actor[i].frames, (unsigned long long)stage->actor[i].last,
                    (unsigned long long)stage->actor[i].term, stage->actor[i].failed ? ": " : "",
                    stage->actor[i].failed ? stage->actor[i].failure : "");
    for (unsigned i = 0; i < STREAMS; i++)
        fprintf(stderr, "  %s: written %llu in %u terms, by %u\n", stream_name[i],
                (unsigned long long)stage->stream[i].done, stage->stream[i].terms, stage->stream[i].owner);
    if (getenv("DDX_CRASH_WAIT"))
        pause(); /* for a debugger */
    /* Failures of parties are broken frames. The parties die with this process. */
    exit(stage->failures ? FRAMES_BROKEN : 1);
}

void director_begin(void) {
    scratch_make();
    char *path = scratch_path("stage");
    setenv("DDX_DIR", scratch_folder, 1);
    setenv("DDX_FAULT_JOURNAL", path, 1);
    free(path);
    stage_open(true);
    for (unsigned i = 0; i < STREAMS; i++)
        stage->stream[i].allowed = ~0u;
}

static pid_t launch(const char *const *arguments, const char *fault) {
    pid_t pid = fork();

    if (pid < 0)
        fail("fork: %s", strerror(errno));
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (fault)
            setenv("DDX_FAULT", fault, 1);
        struct rlimit few = {store_descriptors, store_descriptors};
        if (store_descriptors && arguments[0] == getenv("DDX_STORE_PROGRAM"))
            setrlimit(RLIMIT_NOFILE, &few);
        if (store_log >= 0 && arguments[0] == getenv("DDX_STORE_PROGRAM"))
            dup2(store_log, 2);
        execv(arguments[0], (char *const *)(uintptr_t)arguments);
        _exit(127);
    }
    return pid;
}

void store_begin(const char *fault) {
    const char *program = getenv("DDX_STORE_PROGRAM");
    const char *arguments[] = {program, "-m", store_budget, NULL};

    if (!program)
        fail("DDX_STORE_PROGRAM is not set");
    store_process = launch(arguments, fault);
}

pid_t store_worker(void) {
    return worker_of(store_process);
}

void store_kill_worker(void) {
    pid_t worker;

    AWAIT((worker = store_worker()), "the store has no worker");
    kill(worker, SIGKILL);
}

/* The worker dies a moment after its holder, and serves clients until then. */
static void wait_worker(int worker) {
    struct pollfd gone = {.fd = worker, .events = POLLIN};

    if (worker >= 0 && poll(&gone, 1, (int)(HANG / 1000000)) != 1)
        fail("hang: the worker outlives its holder");
    if (worker >= 0)
        close(worker);
}

static int open_worker(void) {
    pid_t worker = store_process ? store_worker() : 0;

    return worker ? (int)syscall(SYS_pidfd_open, worker, 0) : -1;
}

void store_kill(void) {
    if (!store_process)
        return;
    int worker = open_worker();
    kill(store_process, SIGKILL);
    waitpid(store_process, NULL, 0);
    wait_worker(worker);
    store_process = 0;
}

void store_ended(void) {
    int worker = open_worker();

    AWAIT(waitpid(store_process, NULL, WNOHANG) == store_process, "the store does not end");
    wait_worker(worker);
    store_process = 0;
}

static bool is_stopped(pid_t pid) {
    char path[32], state = 0;

    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *file = fopen(path, "re");
    if (file && fscanf(file, "%*d (%*[^)]) %c", &state) != 1)
        state = 0;
    if (file)
        fclose(file);
    return state == 'T';
}

/* The holder first, or it would start another worker. */
void store_stop(void) {
    pid_t worker;

    kill(store_process, SIGSTOP);
    AWAIT(is_stopped(store_process), "the store cannot be stopped");
    if ((worker = store_worker())) {
        kill(worker, SIGSTOP);
        AWAIT(is_stopped(worker), "the store's worker cannot be stopped");
    }
}

void store_go_on(void) {
    pid_t worker = store_worker();

    if (worker)
        kill(worker, SIGCONT);
    kill(store_process, SIGCONT);
}

struct actor *actor_of(const struct party *p) {
    return &stage->actor[p->index];
}

struct party *party_begin(char kind, unsigned stream, double period, const char *fault) {
    char text[4][16] = {{kind}};
    unsigned index = 0;

    while (index < ACTORS && party[index].pid)
        index++;
    if (index == ACTORS)
        fail("too many parties for the stage");
    snprintf(text[1], sizeof text[1], "%u", stream);
    snprintf(text[2], sizeof text[2], "%u", index);
    snprintf(text[3], sizeof text[3], "%g", period);
    const char *arguments[] = {"/proc/self/exe", "party", text[0], text[1], text[2], text[3], NULL};
    memset(&stage->actor[index], 0, sizeof stage->actor[index]);
    party[index] = (struct party){.index = index, .stream = stream, .kind = kind};
    /* Blocked until the party has its handler (actor_main()): an early TERM would kill the party. */
    sigset_t term;
    sigemptyset(&term);
    sigaddset(&term, SIGTERM);
    sigprocmask(SIG_BLOCK, &term, NULL);
    party[index].pid = launch(arguments, fault);
    sigprocmask(SIG_UNBLOCK, &term, NULL);
    return &party[index];
}

void party_ended(struct party *p, int number) {
    int status = 0;

    AWAIT(waitpid(p->pid, &status, WNOHANG) == p->pid, "%c%u does not end", p->kind, p->index);
    if (number == SIGTERM ? status != 0 : !WIFSIGNALED(status) || WTERMSIG(status) != number)
        fail("%c%u ended with status %x", p->kind, p->index, (unsigned)status);
    p->pid = 0;
}

void party_end(struct party *p, int number) {
    kill(p->pid, number);
    party_ended(p, number);
}

void party_stop(struct party *p) {
    int status;

    p->stopped = true;
    if (kill(p->pid, SIGSTOP) || waitpid(p->pid, &status, WUNTRACED) != p->pid || !WIFSTOPPED(status))
        fail("%c%u cannot be stopped", p->kind, p->index);
}

void party_go_on(struct party *p) {
    p->stopped = false;
    kill(p->pid, SIGCONT);
}

struct party *owner_of(unsigned stream) {
    struct party *owner = &party[stage->stream[stream].owner];

    return owner->pid && owner->kind == 'w' && owner->stream == stream ? owner : NULL;
}

void waited(int64_t ns) {
    if (ns > longest_wait)
        longest_wait = ns;
}

void look(void) {
    if (stage->failures)
        fail("a party complains");
}

static bool is_reader(const struct party *p, unsigned stream) {
    return p->pid && !p->stopped && p->stream == stream && strchr("nokdcm", p->kind);
}

void await_frames(unsigned stream, unsigned frames, uint32_t term, const char *when) {
    uint64_t before[ACTORS];

    for (unsigned i = 0; i < ACTORS; i++)
        before[i] = stage->actor[i].frames;
    for (unsigned i = 0; i < ACTORS; i++)
        if (is_reader(&party[i], stream))
            AWAIT(stage->actor[i].frames >= before[i] + frames && stage->actor[i].term >= term,
                  "%s: %c%u gets no frames", when, party[i].kind, i);
}

struct party *await_takeover(unsigned stream, uint32_t term, const char *when) {
    struct party *first = NULL;

    AWAIT(stage->stream[stream].terms >= term, "%s: no program takes over", when);
    await_frames(stream, 1, term, when);
    for (unsigned i = 0; i < ACTORS; i++)
        if (is_reader(&party[i], stream) && stage->actor[i].term == term &&
            (!first || stage->actor[i].term_time < actor_of(first)->term_time))
            first = &party[i];
    return first;
}

int64_t longest_gap(unsigned stream) {
    int64_t longest = 0;

    for (unsigned i = 0; i < ACTORS; i++)
        if (is_reader(&party[i], stream)) {
            int64_t gap = atomic_exchange(&stage->actor[i].longest, 0);

            longest = gap > longest ? gap : longest;
        }
    return longest;
}

void director_end(void) {
    for (unsigned i = 0; i < ACTORS; i++)
        if (party[i].pid)
            party_end(&party[i], SIGTERM);
    look();
    if (store_process) {
        kill(store_process, SIGTERM);
        waitpid(store_process, NULL, 0);
    }
    printf("longest wait %.0f ms of %.0f\n", (double)longest_wait / 1e6, (double)HANG / 1e6);
}
