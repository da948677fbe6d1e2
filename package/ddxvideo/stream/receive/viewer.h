/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Receives a stream, and puts its pictures into an item, onto a screen, into a file: the settings and the state. */
#ifndef DDXVIDEO_VIEWER_H
#define DDXVIDEO_VIEWER_H

#include <stdatomic.h>

#include "counters.h"
#include "decoder.h"
#include "guard.h"
#include "inlet.h"
#include "stream_rx.h"
#include "link.h"
#include "output.h"
#include "program.h"

enum viewer_loss { LOST_NETWORK, LOST_JOIN, LOST_REFRESH, LOST_DECODE, LOST_STORE, LOST_NEWER };
#define VIEWER_REASONS \
    { "network", "join", "refresh", "decode", "store", "newer", NULL }

struct display;

/* The newest picture, on its way to the screen. */
struct newest {
    AVFrame *picture;
    struct ddxvideo_stamp stamp;
    bool damaged;
    bool waits;   /* it is not on the screen */
    bool counted; /* as shown */
};

/*
 * The target of pictures besides the item. With `each` it gets all pictures, otherwise only the newest of several that
 * come at once.
 */
struct viewer_screen {
    const char *(*show)(void *to, const AVFrame *picture, AVRational rate, const struct ddxvideo_stamp *stamp);
    bool (*tick)(void *to); /* called often (with `each`, at least ten times a second): false to stop. NULL: not
                               needed */
    void *to;
    bool each;
};

enum viewer_report { VIEWER_REPORTS, VIEWER_REPORTS_LOST, VIEWER_REPORT_COUNTS };
#define VIEWER_REPORT_NAMES "reports", "reports_lost"

struct viewer {
    /* settings: */
    struct program program;
    struct inlet inlet;
    long patience; /* ms that a packet waits for a missing one before it */
    bool headless, print;
    bool silent;                 /* send no reports */
    struct viewer_screen screen; /* show: NULL for ddxdecode's window, which `headless` leaves out */
    bool conceal;                /* show damaged pictures */
    struct output_item output;
    struct guard guard;
    /* state: */
    DDX_STORE_ID *id; /* NULL: no store here */
    DDX_STATS_BOOK *book;
    struct counters counters;
    uint64_t packets[STREAM_RX_COUNTS + GUARD_COUNTS + VIEWER_REPORT_COUNTS + LINK_COUNTS]; /* values of the counters */
    struct link link;
    struct stream_rx rx;
    struct sockaddr_storage from; /* where the followed source's packets come from */
    uint64_t reports[VIEWER_REPORT_COUNTS];
    struct decoder decoder;
    struct display *display; /* NULL: no window */
    struct newest newest;
    struct movie movie;
    int64_t counted; /* time of the last count of packets that gave no frame */
    bool shown;      /* a picture of the current source was shown */
    int64_t joining; /* time of the next attempt to join the group */
    struct decoder_limits limits;
    bool said_store;
    bool said_join;
    unsigned said; /* reported of the current source: bits of enum decoder_refusal; SAID_STORE */
    int status;
    atomic_bool done; /* may be set by another thread: stop */
};

/* Show until a stop is requested. Returns the exit status. */
int viewer_run(struct viewer *viewer);

/*
 * show.c writes decoded pictures into the item, and shows them on the screen. If a restored packet releases several
 * frames at once, all of them go into the item, and the newest one onto the screen.
 */

/* Make a window the viewer's screen; if that fails, report it, and go on without one. */
void show_in_window(struct viewer *viewer);
void show_close_window(struct viewer *viewer);

/* Write the picture into the item, count it, and keep it for the screen. */
void show_picture(struct viewer *viewer, const struct assembly_frame *frame, const AVFrame *picture, bool damaged);

/* Show the newest picture on the screen, if there is one. NULL, or the reason of a failure. */
const char *show_newest(struct viewer *viewer);

/* Print why a stream cannot be shown, once a source. */
void show_refusal(struct viewer *viewer);

#endif
