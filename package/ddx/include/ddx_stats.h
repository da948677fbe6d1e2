/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * ddx_stats: frame accounting. Counters of what a program did with its frames, which always add up.
 *
 * Each program keeps one stats book: frames in, frames out, frames lost (by named reason), a histogram of latencies,
 * number of starts. The book is the store item `<instance>.stats` of type DDX_STATS, so that any program can read it,
 * and a restarted program continues with the previous totals. At all times
 *
 *     in = out + waiting + sum(lost)
 *
 * where `waiting` is computed, not counted: frames that came in and are neither out nor lost yet. Unwanted frames
 * (a grabber's -skip) are in none of these; they are counted separately, as `skipped`.
 *
 *     static const char *const reasons[] = {"store", "ring", NULL};
 *     DDX_STATS_BOOK *book = ddx_stats_open("ddxvideosave", reasons);
 *     ddx_stats_attach(book, id, "video");            // optional: without a store the book only counts
 *     ddx_stats_follow(book, ddx_store_seen(item));   // after the first read: account for all later frames
 *     for each frame:
 *         ddx_stats_in(book, 1, frame.sequence);
 *         ddx_stats_out(book, 1, ddx_time_now() - frame.time);      // or ddx_stats_lost(book, REASON_RING, 1)
 *         ddx_stats_write(book);                      // cheap: a 4 KB copy; also shows that the program is alive
 *     ddx_stats_print(book, stdout);
 *     ddx_stats_close(book);                          // a clean stop
 *
 * Threads: several threads may use one book. Only ddx_stats_attach() waits, for the store's answer (5 s at most); all
 * other functions wait at most for another thread's memory copy.
 */
#ifndef DDX_STATS_H
#define DDX_STATS_H

#include <stdio.h>

#include "ddx.h"

#ifdef __cplusplus
extern "C" {
#endif
#pragma GCC visibility push(default)

#define DDX_STATS_VERSION 3
#define DDX_STATS_REASONS 8     /* reasons of loss, "restart" among them */
#define DDX_STATS_REASON_MAX 15 /* longest name of a reason, in bytes */

/*
 * Latency buckets, in µs: below 32 each number has its own; above, each power of two is cut into 32 equal parts, so a
 * bucket's middle is at most 1.6 % off. The last one ends at 2^27 µs (134 s) and also counts longer latencies.
 */
#define DDX_STATS_BUCKETS 736

/* End point of the latency: when the frame was passed on, or when a flush has written the frame to the disk. */
#define DDX_STATS_OUT 0
#define DDX_STATS_DISK 1

/* The value of an item `<instance>.stats`. The layout is the same for 32-bit and 64-bit programs. */
DDX_STORE_TYPE(
    DDX_STATS, struct {
        uint32_t version; /* DDX_STATS_VERSION */
        uint32_t running; /* 1; 0 after a clean stop. Still 1 after a crash */
        uint32_t starts;
        uint32_t reasons; /* entries of `lost` in use */
        uint64_t in;
        uint64_t out;
        uint64_t waiting;
        uint64_t skipped;     /* not wanted, in no sum */
        uint64_t sequence;    /* last sequence number of the source item that is accounted for, 0 if none */
        int64_t first;        /* time of the first frame out, ns of CLOCK_MONOTONIC, 0 if none */
        int64_t last;         /* time of the last frame out */
        uint64_t latency_max; /* µs */
        char source[64];      /* item that the frames come from, "" if none */
        struct {
            char name[16];
            uint64_t frames;
        } lost[DDX_STATS_REASONS];
        uint32_t follows; /* 1: this program, or the next one of this instance, accounts for the source's writes above
                              `sequence`; 0: not wanted */
        uint32_t latency_until; /* end point of the latency: DDX_STATS_OUT or DDX_STATS_DISK */
        uint64_t publishing;    /* number that the frame being published gets in the item; 0: none is being published */
        uint64_t died; /* part of lost "restart": lost when the last program died; some may be found on the disk */
        uint64_t file_device, file_inode; /* file that frames counted as `out` go to now; 0: not in a file */
        uint64_t file_out;                /* `out` when that file was begun */
        uint64_t out_sequence; /* number in the source of the last frame out, if the program reports it; else 0 */
        uint32_t latency[DDX_STATS_BUCKETS]; /* frames out, by latency */
    });

typedef struct ddx_stats_book DDX_STATS_BOOK;

/*
 * Open a new book. `reasons` ends with NULL: at most DDX_STATS_REASONS - 1 names of at most DDX_STATS_REASON_MAX bytes;
 * "restart" is added after them. Strings are copied. NULL and errno (EINVAL, ENOMEM) on failure. The caller owns the
 * book, until ddx_stats_close().
 */
DDX_STATS_BOOK *ddx_stats_open(const char *instance, const char *const *reasons);

/*
 * DDX_STATS_DISK: this program counts a frame as out when it is on the disk, so its latencies contain the wait for the
 * next flush; programs that show latencies mark them so. Default DDX_STATS_OUT. To be called before ddx_stats_attach().
 */
void ddx_stats_latency_until(DDX_STATS_BOOK *book, uint32_t until);

/*
 * Keep the book in the store, as item `<instance>.stats`, and take over the counters that the previous program of this
 * instance left there: its totals are added, `starts` continues, and if it died (no clean stop), its waiting frames
 * become lost "restart". `source`: name of the item that the frames come from, or NULL; see ddx_stats_follow(). The
 * connection remains the caller's and must outlive the book. Errors: -EEXIST (a living program of this instance keeps
 * its counters there), -EPROTOTYPE or -EMSGSIZE (an item of another type has that name), else as ddx_store_create(). On
 * failure the book continues to count, without the store. At most once per book.
 */
int ddx_stats_attach(DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source);

/*
 * From now on this program accounts for each write of the source item whose number is above `sequence`. To be called
 * once the source keeps frames for this program (ddx_store_seen()), before it counts the first one. If the previous
 * program followed the source and had no clean stop (it died, or called ddx_stats_fail()), the frames written since its
 * last one are now counted as in and as lost "restart"; returns their number. If numbering has started again, these are
 * all frames.
 */
uint64_t ddx_stats_follow(DDX_STATS_BOOK *book, uint64_t sequence);

/*
 * The same for a program that does not want every frame. `wanted` returns how many of the writes 1 to `sequence` the
 * programs of this instance want (NULL: all of them); the unwanted writes of the gap are counted as skipped. Returns
 * the number of lost frames.
 */
typedef uint64_t ddx_stats_wanted(const void *argument, uint64_t sequence);
uint64_t ddx_stats_follow_some(DDX_STATS_BOOK *book, uint64_t sequence, ddx_stats_wanted *wanted, const void *argument);

/*
 * The program will exit without a request to stop, so frames written to the source until the next start are lost:
 * ddx_stats_close() leaves the book in a state in which the next program of this instance counts them.
 */
void ddx_stats_fail(DDX_STATS_BOOK *book);

/*
 * For a program that writes an item. To be called right before publishing a frame that has been counted as in; `number`
 * is the frame's number in the item, ddx_store_written() + 1. Writes the book, as ddx_stats_write(). If the program
 * dies before it has counted that frame as out or lost, the next program decides which, with ddx_stats_published().
 */
int ddx_stats_publishing(DDX_STATS_BOOK *book, uint64_t number);

/*
 * To be called by a new writer, after it has attached its book and created the item; `written` is ddx_store_written().
 * The frame that its predecessor was publishing when it died is `out` if it is in the item, else lost "restart".
 */
void ddx_stats_published(DDX_STATS_BOOK *book, uint64_t written);

/*
 * For a program that keeps frames in files. ddx_stats_file(): frames out from now on are in this file.
 * ddx_stats_out_numbered(), for files that contain the numbers of their frames: one frame is out, as ddx_stats_out(),
 * and had this number in the source. Neither writes the book.
 */
void ddx_stats_file(DDX_STATS_BOOK *book, uint64_t device, uint64_t inode);
void ddx_stats_out_numbered(DDX_STATS_BOOK *book, uint64_t sequence, int64_t latency);

/*
 * After ddx_stats_attach(), if the previous program died: `frames` of the frames counted as `died` were found in the
 * files that it left (see `died`, file_... and out_sequence of ddx_stats_get()), so they are out, not lost. To be
 * called once.
 */
void ddx_stats_found(DDX_STATS_BOOK *book, uint64_t frames);

/* Frames that were counted as out but turned out to be lost. Reasons as for ddx_stats_lost(). */
void ddx_stats_take_back(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames);

/* Frames that came in; `sequence`: number of the last of them in the source item, 0 if it has none. */
void ddx_stats_in(DDX_STATS_BOOK *book, uint64_t frames, uint64_t sequence);

/* Frames that went out now, each with this latency (ns; negative counts as 0). */
void ddx_stats_out(DDX_STATS_BOOK *book, uint64_t frames, int64_t latency);

/* Frames lost; `reason` is an index into the `reasons` given to ddx_stats_open(). */
void ddx_stats_lost(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames);

/* Frames left out on request. */
void ddx_stats_skipped(DDX_STATS_BOOK *book, uint64_t frames);

/* Write the book into the store; 0 when it is not attached. Errors as ddx_store_write(). */
int ddx_stats_write(DDX_STATS_BOOK *book);

/* A consistent copy. */
void ddx_stats_get(DDX_STATS_BOOK *book, DDX_STATS *stats);

/* Print the JSON line of the book, with a line feed, flushed. */
void ddx_stats_print(DDX_STATS_BOOK *book, FILE *file);

/*
 * A clean stop, unless ddx_stats_fail() was called: write the book a last time, with running = 0, and free it. NULL is
 * allowed. The caller must have counted every frame as out or lost. To be called before ddx_store_close().
 */
void ddx_stats_close(DDX_STATS_BOOK *book);

/* ---- For readers of the item ---- */

/*
 * Write the JSON line, without line feed, into line[size], always terminated; returns its length, as snprintf() does.
 * Does not trust *stats. DDX_STATS_LINE_MAX bytes are enough for names of at most DDX_NAME_MAX bytes.
 *
 *   {"instance":"ddxvideosave","in":500,"out":500,"waiting":0,"skipped":0,
 *    "lost":{"store":0,"ring":0,"write":0,"restart":0},
 *    "latency_us":{"p50":120,"p99":900,"max":2100},"latency_until":"out",
 *    "starts":1,"first_ns":1234567890,"last_ns":2234567890}
 *
 * "latency_until" is "disk" for a program that called ddx_stats_latency_until() with DDX_STATS_DISK, such as ddxlog.
 */
#define DDX_STATS_LINE_MAX 2048
int ddx_stats_json(const DDX_STATS *stats, const char *instance, char *line, size_t size);

/* The latency in µs that `share` (0 to 1) of the frames do not exceed; 0 if there are no frames. */
uint64_t ddx_stats_percentile(const DDX_STATS *stats, double share);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
