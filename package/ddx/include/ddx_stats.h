/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * ddx_stats: what a program did with its frames, in numbers that add up.
 *
 * Every program of this family keeps one book: frames in, frames out, frames lost (by named reason), a histogram of
 * latencies, how often it was started. The book lives in the store as item `<instance>.stats` of type DDX_STATS, so
 * that any program can read it, and a restarted program continues with the previous totals. At all
 * times
 *
 *     in = out + waiting + sum(lost)
 *
 * where `waiting` is computed, not kept: frames that came in and have not been accounted for yet. Unwanted frames
 * (a grabber's -skip) are in none of these; they are counted beside them, as `skipped`.
 *
 *     static const char *const reasons[] = {"store", "ring", NULL};
 *     DDX_STATS_BOOK *book = ddx_stats_open("ddxvideosave", reasons);
 *     ddx_stats_attach(book, id, "video");            // optional: without a store the book only counts
 *     ddx_stats_follow(book, ddx_store_seen(item));   // after the first read: what comes from now on is ours
 *     for each frame:
 *         ddx_stats_in(book, 1, frame.sequence);
 *         ddx_stats_out(book, 1, ddx_time_now() - frame.time);      // or ddx_stats_lost(book, REASON_RING, 1)
 *         ddx_stats_write(book);                      // cheap: a 4 KB copy; also the program's liveness
 *     ddx_stats_print(book, stdout);
 *     ddx_stats_close(book);                          // a clean stop
 *
 * Threads: all functions on a book may be called by several threads; none waits for anything but a memory copy, except
 * ddx_stats_attach(), which waits for the store's answer (5 s at most).
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
 * bucket's middle is at most 1.6 % off. The last one ends at 2^27 µs (134 s) and also takes what is longer.
 */
#define DDX_STATS_BUCKETS 736

/* Where a latency stops: when the frame was handed on, or when a flush has brought it onto the disk. */
#define DDX_STATS_OUT 0
#define DDX_STATS_DISK 1

/* The value of an item `<instance>.stats`. The layout is the same for 32-bit and 64-bit programs. */
DDX_STORE_TYPE(
    DDX_STATS, struct {
        uint32_t version; /* DDX_STATS_VERSION */
        uint32_t running; /* 1; 0 after a clean stop. A dead program leaves 1 */
        uint32_t starts;
        uint32_t reasons; /* entries of `lost` in use */
        uint64_t in;
        uint64_t out;
        uint64_t waiting;
        uint64_t skipped;     /* left out as told, in no sum */
        uint64_t sequence;    /* last sequence number accounted for of the source item, 0 if none */
        int64_t first;        /* time of the first frame out, ns of CLOCK_MONOTONIC, 0 if none */
        int64_t last;         /* time of the last frame out */
        uint64_t latency_max; /* µs */
        char source[64];      /* item that the frames come from, "" if none */
        struct {
            char name[16];
            uint64_t frames;
        } lost[DDX_STATS_REASONS];
        uint32_t follows;  /* 1: writes of the source above `sequence` are to be accounted for, by this program or the
                              next one of this instance; 0: not wanted */
        uint32_t latency_until; /* where the latency of a frame stops: DDX_STATS_OUT or DDX_STATS_DISK */
        uint64_t publishing; /* number that the frame which goes into an item now gets there; 0: none does */
        uint64_t died; /* of lost "restart": with the last program; what it left on the disk may hold some of them */
        uint64_t file_device, file_inode; /* where frames that are `out` go now; 0: not in a file */
        uint64_t file_out;                /* `out` when that file was begun */
        uint64_t out_sequence; /* number in the source of the last frame out, where the program tells that; else 0 */
        uint32_t latency[DDX_STATS_BUCKETS]; /* frames out, by latency */
    });

typedef struct ddx_stats_book DDX_STATS_BOOK;

/*
 * A new book. `reasons` ends with NULL: at most DDX_STATS_REASONS - 1 names of at most DDX_STATS_REASON_MAX bytes;
 * "restart" is added after them. Strings are copied. NULL and errno (EINVAL, ENOMEM) on failure. The book is the
 * caller's, until ddx_stats_close().
 */
DDX_STATS_BOOK *ddx_stats_open(const char *instance, const char *const *reasons);

/*
 * DDX_STATS_DISK: this program counts a frame as out when it is on the disk, so its latencies contain the wait for the
 * next flush; programs that show them say so. Without this call, DDX_STATS_OUT. To be called before ddx_stats_attach().
 */
void ddx_stats_latency_until(DDX_STATS_BOOK *book, uint32_t until);

/*
 * Keep the book in the store, as item `<instance>.stats`, and take over what a former program of this instance left
 * there: its totals are added, `starts` goes on, and if it died (no clean stop), what was waiting in it becomes
 * lost "restart". `source`: name of the item that the frames come from, or NULL; see ddx_stats_follow(). The
 * connection stays the caller's and must outlive the book. Errors: -EEXIST (a living program is this instance:
 * it keeps counters there), -EPROTOTYPE or -EMSGSIZE (something else has that name), else as ddx_store_create(). On
 * failure the book goes on counting, without the store. At most once per book.
 */
int ddx_stats_attach(DDX_STATS_BOOK *book, DDX_STORE_ID *id, const char *source);

/*
 * From now on this program accounts for each write of the source item whose number is above `sequence`: to be called
 * when the source keeps frames for it (ddx_store_seen()), before the first one is counted. If a former program did so
 * and did not end as told (it died, or see ddx_stats_fail()), what was written since its last frame is counted now, as
 * in and as lost "restart"; returns their number. If numbering has started again, these are all frames.
 */
uint64_t ddx_stats_follow(DDX_STATS_BOOK *book, uint64_t sequence);

/*
 * The same for a program that does not want each frame. `wanted` says how many of the writes 1 to `sequence` it wants
 * (or wanted, as all programs of this instance do); the others of that gap are counted as skipped. Returns how many
 * were lost. NULL: each.
 */
typedef uint64_t ddx_stats_wanted(const void *argument, uint64_t sequence);
uint64_t ddx_stats_follow_some(DDX_STATS_BOOK *book, uint64_t sequence, ddx_stats_wanted *wanted,
                               const void *argument);

/*
 * The program is going to exit without a request to stop: frames written to the source until the next start are lost,
 * and ddx_stats_close() leaves the book so that the next program of this instance counts them.
 */
void ddx_stats_fail(DDX_STATS_BOOK *book);

/*
 * For a program that writes an item. Right before a frame, which has been counted as in, is published: `number` is what
 * it will have in the item, ddx_store_written() + 1. Writes the book, as ddx_stats_write(). Should the program die
 * before it has counted that frame as out or lost, its successor finds out what became of it:
 */
int ddx_stats_publishing(DDX_STATS_BOOK *book, uint64_t number);

/*
 * To be called by a writer that begins, when it has attached its book and created the item; `written` is
 * ddx_store_written(). The frame that its forerunner died with is `out` if it is in the item, else lost "restart".
 */
void ddx_stats_published(DDX_STATS_BOOK *book, uint64_t written);

/*
 * For a program that keeps frames in files. What is out from now on is in this file; or, where files say which frames
 * they have: one frame is out, as ddx_stats_out(), and it had this number in the source. Neither writes the book.
 */
void ddx_stats_file(DDX_STATS_BOOK *book, uint64_t device, uint64_t inode);
void ddx_stats_out_numbered(DDX_STATS_BOOK *book, uint64_t sequence, int64_t latency);

/*
 * After ddx_stats_attach(), where a former program died: `frames` of those that died with it were found on the disk, in
 * what it left (ddx_stats_get() tells of `died`, file_... and out_sequence): they are out, not lost. To be called once.
 */
void ddx_stats_found(DDX_STATS_BOOK *book, uint64_t frames);

/* Frames that have been counted as out, and are lost after all. Reasons as for ddx_stats_lost(). */
void ddx_stats_take_back(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames);

/* Frames that came in; `sequence` of the last of them in the source item, 0 if it has none. */
void ddx_stats_in(DDX_STATS_BOOK *book, uint64_t frames, uint64_t sequence);

/* Frames that went out now, each with this latency (ns; negative counts as 0). */
void ddx_stats_out(DDX_STATS_BOOK *book, uint64_t frames, int64_t latency);

/* Frames lost for the reason of this number in the `reasons` given to ddx_stats_open(). */
void ddx_stats_lost(DDX_STATS_BOOK *book, unsigned reason, uint64_t frames);

/* Frames that were left out because that was asked for. */
void ddx_stats_skipped(DDX_STATS_BOOK *book, uint64_t frames);

/* Write the book into the store; 0 when it is not attached. Errors as ddx_store_write(). */
int ddx_stats_write(DDX_STATS_BOOK *book);

/* A consistent copy. */
void ddx_stats_get(DDX_STATS_BOOK *book, DDX_STATS *stats);

/* The JSON line of the book, with a line feed, flushed. */
void ddx_stats_print(DDX_STATS_BOOK *book, FILE *file);

/*
 * A clean stop, unless ddx_stats_fail() was called: written a last time with running = 0, given back, freed. NULL is
 * allowed. The caller has counted every frame as out or lost. Call it before ddx_store_close().
 */
void ddx_stats_close(DDX_STATS_BOOK *book);

/* ---- For readers of the item ---- */

/*
 * The JSON line, without line feed, into line[size], always terminated; returns its length, as snprintf() does.
 * Does not trust *stats. DDX_STATS_LINE_MAX bytes are always enough for names of at most DDX_NAME_MAX bytes.
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

/* The latency in µs below or at which `share` (0 to 1) of the frames are; 0 if there are none. */
uint64_t ddx_stats_percentile(const DDX_STATS *stats, double share);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
