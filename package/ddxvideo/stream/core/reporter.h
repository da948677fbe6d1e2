/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Decides when a receiver reports to the sender, and writes the reports. No sockets, no clock: time is a parameter
 * (CLOCK_MONOTONIC, ns).
 *
 * - After packets came; once for all that come together.
 * - Again after REPORTER_REPEAT_NS, if enough reports are left: otherwise a lost report looks like a lost frame.
 * - Every REPORTER_REPEAT_NS while something is missing, or while a packet is due and has not come: the rest of a frame
 *   whose last packet (marker) is not there, or the next frame, whose time follows from RTP time stamps. So the loss
 *   of the last packet is reported without waiting for the packet after it.
 * - Nothing when no packet came for REPORTER_QUIET_NS: the sender is gone.
 *
 * One report is kept for the next arrival: after an outage it is reported at once.
 *
 * On average at most 60 kbit/s, IP and UDP headers included: 122 reports a second. 39 of them are saved for an
 * outage, in which each one may be the first that arrives. 25 frames a second at 30 % loss need 55.
 */
#ifndef DDXVIDEO_REPORTER_H
#define DDXVIDEO_REPORTER_H

#include "budget.h"
#include "report.h"
#include "restore.h"

#define REPORTER_REPEAT_NS INT64_C(5000000)
#define REPORTER_QUIET_NS INT64_C(500000000)
#define REPORTER_SLOTS 4 /* of 0.5 s, in which losses are counted */

/* One of the two received streams: media and repair. */
struct reporter_stream {
    bool begun;
    uint16_t highest;
};

struct reporter {
    uint32_t ssrc, media_ssrc;
    size_t header;
    bool refresh; /* may be set by the caller: a picture loss indication goes with each report until it is cleared */
    struct budget budget;
    struct reporter_stream media, repair;
    struct rtp_stranger stranger; /* of the repair stream */
    int64_t arrived;              /* time of the newest packet */
    int64_t reported;             /* time of the last report */
    bool fresh;                   /* packets came since then */
    bool again;                   /* repeat that report once */
    bool open;                    /* the newest media packet is not the last one of its frame */
    /* the next frame */
    uint32_t time;    /* RTP's, of the newest frame */
    int64_t stamp;    /* the same in ns */
    int64_t interval; /* ns from frame to frame */
    int64_t offset;   /* from stamps to arrivals */
    /* losses */
    int64_t slot_begin;
    unsigned expected[REPORTER_SLOTS], received[REPORTER_SLOTS];
    double run_mean; /* packets lost in sequence, the mean of the last runs */
};

/* `ssrc`: of this receiver, at random. `header`: bytes of IP and UDP headers, and what encryption adds. A new source
 * needs reporter_init() again. */
void reporter_init(struct reporter *reporter, uint32_t ssrc, uint32_t media_ssrc, size_t header, int64_t now);

/* Note a media packet (not a restored one) that restore_source() did not refuse, or a repair packet that
 * restore_repair() did not refuse, with its own sequence number. */
void reporter_media(struct reporter *reporter, int64_t now, uint16_t sequence, uint32_t time, bool marker);
void reporter_repair(struct reporter *reporter, int64_t now, uint16_t sequence);

/* Loss of the last 2 s in percent. */
unsigned reporter_loss(const struct reporter *reporter);

/* Write the report that is due to to[REPORT_MAX]. Returns its size; 0: none is due. */
size_t reporter_next(struct reporter *reporter, int64_t now, const struct restore *restore, uint8_t *to);

/* The time at which the next report is due if no packet comes; INT64_MAX: never. */
int64_t reporter_deadline(const struct reporter *reporter, const struct restore *restore);

#endif
