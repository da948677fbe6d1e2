/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "puppet.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "../../package/ddx/lib/handle.h"
#include "../../package/ddx/lib/roles.h"

#define PUPPETS 16
#define NAME stream_name[0]

struct message {
    enum order order;
    int64_t n;
};

static struct puppet puppets[PUPPETS];

/* ---- the program ---- */
static DDX_STORE_ID *id;
static DDX_STORE_ITEM *item;
static struct ddx_frame held;

static int64_t write_frames(int64_t count) {
    static uint64_t number;
    void *data;

    if (!count) {
        int result = ddx_store_loan(item, &data);

        return result ? result : ddx_store_cancel(item);
    }
    for (int64_t i = 0; i < count; i++) {
        int result = ddx_store_loan(item, &data);

        if (result)
            return result;
        FRAME *frame = data;
        frame->number = item->writer.ring.sequence + 1;
        for (unsigned word = 0; word < WORDS; word++)
            frame->word[word] = content(frame->number, 0, word);
        number = frame->number;
        if ((result = ddx_store_publish(item, NULL)) != 0)
            return result;
    }
    return (int64_t)number;
}

static int64_t look_at_frame(void) {
    const FRAME *frame = held.data;

    for (unsigned word = 0; word < WORDS; word++)
        if (frame->word[word] != content(held.sequence, 0, word))
            return -EBADMSG;
    return (int64_t)held.sequence;
}

/* Acts as if the store had hung up after this program was stopped. */
static int64_t hang_up(void) {
    ddx_lock_take(&item->lock);
    shutdown(item->socket, SHUT_RDWR);
    raise(SIGSTOP);
    ddx_lock_give(&item->lock);
    return 0;
}

static int set_limit(int64_t more) {
    struct rlimit room;
    int fd = -1;

    getrlimit(RLIMIT_NOFILE, &room);
    room.rlim_cur = room.rlim_max;
    setrlimit(RLIMIT_NOFILE, &room);
    if (more >= 0) {
        int taken[16];

        for (int64_t i = 0; i <= more; i++)
            taken[i] = fd = dup(0);
        for (int64_t i = 0; i <= more; i++)
            close(taken[i]);
        room.rlim_cur = (rlim_t)fd;
    }
    return setrlimit(RLIMIT_NOFILE, &room) ? -errno : 0;
}

/* The lock: a message's descriptors, which the keeper closes after it has handled the message, must not count. */
static int64_t limit(int64_t more) {
    if (!item)
        return set_limit(more);
    ddx_lock_take(&item->lock);
    int64_t answer = set_limit(more);
    ddx_lock_give(&item->lock);
    return answer;
}

static int64_t look_at_lock(int64_t times) {
    int64_t free = 0;

    for (int64_t i = 0; i < times; i++) {
        bool got = ddx_lock_try(&item->lock);

        if (got)
            ddx_lock_give(&item->lock);
        free += got;
        nap(0.01);
    }
    return free;
}

static int64_t leave_store(void) {
    ddx_lock_take(&item->lock);
    ddx_item_disconnect(item);
    item->retry += 1000000000; /* does not reconnect at once */
    ddx_lock_give(&item->lock);
    return 0;
}

static int64_t have_child(void) {
    pid_t pid = fork();

    if (pid == 0) {
        alarm(30);
        pause();
        _exit(0);
    }
    return pid;
}

static int64_t ask_info(void) {
    struct ddx_item_info info;
    int result = ddx_store_item_info(item, &info);

    return result ? result : (int64_t)info.readers;
}

static int64_t obey(const struct message *message) {
    int result;

    switch (message->order) {
    case ORDER_LOOKUP: item = ddx_store_lookup_item(id, NAME, "FRAME", sizeof(FRAME)); return item ? 0 : -errno;
    case ORDER_KEEP: return ddx_store_keep(item, (unsigned)message->n);
    case ORDER_WRITE: return write_frames(message->n);
    case ORDER_JUMP: item->writer.ring.sequence = (uint64_t)message->n - 1; return 0;
    case ORDER_NEXT:
    case ORDER_HOLD:
        ddx_store_release(item);
        result = ddx_store_acquire(item, &held, (double)message->n,
                                   message->order == ORDER_NEXT ? DDX_IN_ORDER : DDX_CURRENT);
        return result ? result : look_at_frame();
    case ORDER_LOOK: return look_at_frame();
    case ORDER_RELEASE: return ddx_store_release(item);
    case ORDER_DONE: return ddx_store_done_item(item);
    case ORDER_SHORT: return (int64_t)ddx_store_short(item);
    case ORDER_LIMIT: return limit(message->n);
    case ORDER_FREE: return look_at_lock(message->n);
    case ORDER_LEAVE: return leave_store();
    case ORDER_FORK: return have_child();
    case ORDER_READERS: return ddx_store_readers(item);
    case ORDER_INFO: return ask_info();
    case ORDER_HANG_UP: return hang_up();
    default: return -ENOSYS;
    }
}

int puppet_main(int wire) {
    struct message message;

    prctl(PR_SET_PDEATHSIG, SIGKILL);
    stage_open(false);
    id = ddx_store_open(NULL, 0, 30);
    while (id && recv(wire, &message, sizeof message, 0) == sizeof message) {
        int64_t answer = obey(&message);

        if (send(wire, &answer, sizeof answer, MSG_NOSIGNAL) < 0)
            break;
    }
    return 0;
}

/* ---- the program that gives the commands ---- */
struct puppet *puppet_begin(const char *fault) {
    struct puppet *puppet = puppets;
    int ends[2];
    char text[16];

    while (puppet < puppets + PUPPETS && puppet->pid)
        puppet++;
    if (puppet == puppets + PUPPETS || socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends))
        fail("no puppet");
    pid_t pid = fork();
    if (pid == 0) {
        int wire = dup(ends[1]); /* not closed by exec */

        prctl(PR_SET_PDEATHSIG, SIGKILL);
        if (fault)
            setenv("DDX_FAULT", fault, 1);
        snprintf(text, sizeof text, "%d", wire);
        execl("/proc/self/exe", "crash", "puppet", text, (char *)NULL);
        _exit(127);
    }
    close(ends[1]);
    *puppet = (struct puppet){pid, ends[0]};
    ASK(puppet, LOOKUP, 0, 0);
    return puppet;
}

void puppet_say(struct puppet *puppet, enum order order, int64_t n) {
    struct message message = {order, n};

    if (send(puppet->wire, &message, sizeof message, MSG_NOSIGNAL) < 0)
        fail("a puppet has ended");
}

int64_t puppet_hear(struct puppet *puppet) {
    struct pollfd wait = {.fd = puppet->wire, .events = POLLIN};
    int64_t answer, since = ddx_time_now();

    if (poll(&wait, 1, 2 * (int)(HANG / 1000000)) <= 0)
        fail("hang: puppet %d does not answer", (int)puppet->pid);
    if (recv(puppet->wire, &answer, sizeof answer, 0) != sizeof answer)
        fail("puppet %d has ended", (int)puppet->pid);
    waited(ddx_time_now() - since);
    return answer;
}

int64_t puppet_ask(struct puppet *puppet, enum order order, int64_t n) {
    puppet_say(puppet, order, n);
    return puppet_hear(puppet);
}

void puppet_await_stop(struct puppet *puppet) {
    int status;

    if (waitpid(puppet->pid, &status, WUNTRACED) != puppet->pid || !WIFSTOPPED(status))
        fail("a puppet cannot be stopped");
}

void puppet_stop(struct puppet *puppet) {
    kill(puppet->pid, SIGSTOP);
    puppet_await_stop(puppet);
}

void puppet_go_on(struct puppet *puppet) {
    kill(puppet->pid, SIGCONT);
}

void puppet_kill(struct puppet *puppet) {
    kill(puppet->pid, SIGKILL);
    waitpid(puppet->pid, NULL, 0);
    close(puppet->wire);
    puppet->pid = 0;
}

void puppets_end(void) {
    for (unsigned i = 0; i < PUPPETS; i++)
        if (puppets[i].pid)
            puppet_kill(&puppets[i]);
    store_kill();
}

bool read_info(struct ddx_item_info *info) {
    static DDX_STORE_ID *own;
    struct ddx_item_info *items;
    unsigned count;
    bool found = false;

    if ((!own && !(own = ddx_store_open(NULL, 0, 0))) || ddx_store_list(own, NULL, &items, &count))
        return false;
    for (unsigned i = 0; i < count; i++)
        if (!strcmp(items[i].name, NAME)) {
            *info = items[i];
            found = true;
        }
    free(items);
    return found;
}
