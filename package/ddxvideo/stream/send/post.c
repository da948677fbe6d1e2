/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "post.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "ddx_time.h"
#include "program.h"

#define IDLE_NS (SECOND / 5) /* the longest wait without packets or reports */
#define BATCH_DATAGRAMS 64   /* datagrams read in one turn, so that a flood does not stop packets from being sent */
#define REPORT_DATAGRAM 1500
#define MARKER 0x80 /* of the second byte of an RTP packet: the last one of its frame */

/* ---- Packets; the lock is held ---- */

static unsigned all_receivers(const struct post *post) {
    return (1u << post->outlet->receivers) - 1;
}

static void end_frame(struct post *post) {
    if (!post->open)
        return;
    if (post->missed == all_receivers(post)) {
        post->outcome.lost++;
    } else {
        post->outcome.sent++;
        post->outcome.latency = ddx_time_now() - post->written[post->first];
    }
    post->missed = 0;
    post->first = (post->first + 1) % POST_FRAMES;
    post->open--;
}

/* Sends the same bytes to all receivers; a bit for each receiver for which that failed. */
static unsigned send_packet(struct post *post, enum outlet_port to, uint8_t *packet, size_t size) {
    int error = post->secure ? secure_protect(post->secure, packet, &size) : 0;

    if (!error)
        return outlet_send(post->outlet, to, packet, size);
    post->outlet->error = -error;
    post->outlet->lost[OUTLET_OTHER] += post->outlet->receivers;
    return all_receivers(post);
}

/* Send what is due. */
static void send_due(struct post *post) {
    uint8_t packet[REPAIR_MAX + SECURE_ROOM] __attribute__((aligned(4)));
    enum stream_tx_port port;
    size_t size;

    while (stream_tx_next(&post->tx, ddx_time_now(), packet, &size, &port)) {
        enum outlet_port to = port == STREAM_TX_MEDIA ? OUTLET_MEDIA : OUTLET_REPAIR;
        unsigned missed = send_packet(post, to, packet, size);

        if (port != STREAM_TX_MEDIA)
            continue;
        post->missed |= missed;
        if (packet[1] & MARKER)
            end_frame(post);
    }
}

static void read_reports(struct post *post) {
    uint8_t data[REPORT_DATAGRAM + SECURE_ROOM] __attribute__((aligned(4)));
    uint64_t address;
    ssize_t came;

    for (int i = 0; i < BATCH_DATAGRAMS && (came = outlet_read(post->outlet, data, REPORT_DATAGRAM, &address)) >= 0;
         i++) {
        size_t size = came > REPORT_DATAGRAM ? 0 : (size_t)came; /* cut off: not a report, like an empty datagram */

        if (size && post->secure && secure_unprotect_report(post->secure, data, &size))
            size = 0;
        stream_tx_report(&post->tx, ddx_time_now(), data, size, address);
    }
}

/* ---- The thread ---- */

static void wait_for_work(struct post *post, int64_t until) {
    struct pollfd wanted[1 + OUTLET_SOCKETS] = {{.fd = post->wake, .events = POLLIN}};
    int64_t wait = until - ddx_time_now();
    eventfd_t value;

    wait = wait < 0 ? 0 : wait;
    for (int i = 0; i < OUTLET_SOCKETS; i++)
        wanted[1 + i] = (struct pollfd){.fd = post->outlet->fd[i], .events = POLLIN};
    ppoll(wanted, 1 + OUTLET_SOCKETS, &(struct timespec){.tv_nsec = (long)wait}, NULL);
    if (wanted[0].revents)
        eventfd_read(post->wake, &value);
}

static void *run_thread(void *data) {
    struct post *post = data;
    bool stopping = false;

    program_thread_signals();
    while (!stopping) {
        pthread_mutex_lock(&post->lock);
        read_reports(post);
        send_due(post);
        int64_t now = ddx_time_now(), until = stream_tx_deadline(&post->tx, now);
        post->until = until = until < now + IDLE_NS ? until : now + IDLE_NS;
        stopping = post->stopping;
        pthread_mutex_unlock(&post->lock);
        if (!stopping)
            wait_for_work(post, until);
    }
    return NULL;
}

static void wake_thread(struct post *post) {
    eventfd_write(post->wake, 1);
}

/* ---- For the program's thread ---- */

int post_start(struct post *post, struct outlet *outlet, struct secure *secure,
               const struct stream_tx_settings *settings) {
    memset(post, 0, sizeof *post);
    post->outlet = outlet;
    post->secure = secure;
    stream_tx_init(&post->tx, settings, ddx_time_now());
    post->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (post->wake < 0)
        return -errno;
    pthread_mutex_init(&post->lock, NULL);
    int error = -pthread_create(&post->thread, NULL, run_thread, post);
    post->running = !error;
    if (error)
        close(post->wake);
    return error;
}

void post_set_interval(struct post *post, int64_t interval) {
    pthread_mutex_lock(&post->lock);
    post->tx.settings.interval = interval;
    pthread_mutex_unlock(&post->lock);
}

size_t post_allowance(struct post *post) {
    pthread_mutex_lock(&post->lock);
    size_t bytes = stream_tx_allowance(&post->tx, ddx_time_now());
    pthread_mutex_unlock(&post->lock);
    return bytes;
}

bool post_wants_refresh(struct post *post, size_t *whole) {
    pthread_mutex_lock(&post->lock);
    bool wants = stream_tx_wants_refresh(&post->tx, ddx_time_now(), whole);
    pthread_mutex_unlock(&post->lock);
    return wants;
}

bool post_frame(struct post *post, int64_t written, const struct rtp_packet *packet, const uint8_t *data, size_t size) {
    pthread_mutex_lock(&post->lock);
    bool taken = post->open < POST_FRAMES && stream_tx_frame(&post->tx, ddx_time_now(), *packet, data, size);
    if (taken) {
        post->written[(post->first + post->open++) % POST_FRAMES] = written;
        send_due(post);
    }
    bool rest = stream_tx_deadline(&post->tx, ddx_time_now()) < post->until;
    pthread_mutex_unlock(&post->lock);
    if (rest) /* of most frames, all packets have gone: the thread has nothing to do */
        wake_thread(post);
    return taken;
}

bool post_other(struct post *post, size_t size) {
    pthread_mutex_lock(&post->lock);
    bool may_go = stream_tx_other(&post->tx, ddx_time_now(), size);
    pthread_mutex_unlock(&post->lock);
    return may_go;
}

struct post_outcome post_collect(struct post *post) {
    pthread_mutex_lock(&post->lock);
    struct post_outcome outcome = post->outcome;
    post->outcome = (struct post_outcome){0};
    pthread_mutex_unlock(&post->lock);
    return outcome;
}

void post_counts(struct post *post, uint64_t tx[STREAM_TX_COUNTS], uint64_t feedback[FEEDBACK_COUNTS],
                 struct outlet *outlet) {
    pthread_mutex_lock(&post->lock);
    memcpy(tx, post->tx.count, sizeof post->tx.count);
    memcpy(feedback, post->tx.feedback.count, sizeof post->tx.feedback.count);
    *outlet = *post->outlet;
    pthread_mutex_unlock(&post->lock);
}

void post_losses(struct post *post, double *loss, double *run) {
    pthread_mutex_lock(&post->lock);
    feedback_losses(&post->tx.feedback, ddx_time_now(), loss, run);
    pthread_mutex_unlock(&post->lock);
}

/* Whether frames wait that can still be sent. */
static bool has_open_frames(struct post *post) {
    pthread_mutex_lock(&post->lock);
    bool open = post->open > 0;
    pthread_mutex_unlock(&post->lock);
    return open;
}

void post_stop(struct post *post) {
    if (!post->running)
        return;
    int64_t until = ddx_time_now() + post->tx.settings.interval;
    while (has_open_frames(post) && ddx_time_now() < until)
        nanosleep(&(struct timespec){.tv_nsec = SECOND / 1000}, NULL);
    pthread_mutex_lock(&post->lock);
    post->stopping = true;
    pthread_mutex_unlock(&post->lock);
    wake_thread(post);
    pthread_join(post->thread, NULL);
    post->running = false;
    post->outcome.lost += post->open;
    post->open = 0;
    close(post->wake);
    pthread_mutex_destroy(&post->lock);
}
