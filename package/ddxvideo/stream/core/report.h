/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Reports of a receiver to the sender: RTCP (RFC 3550), feedback of the transport and the codec (RFC 4585), in
 * datagrams of reduced size (RFC 5506: no report of RFC 3550 has to come first). No sockets, no clock.
 *
 * A report is an application layer feedback packet (payload type 206, format 15); big endian:
 *
 *    0   version 2, padding 0, format 15 | 206 | length in words - 1: 7
 *    4   SSRC of the reporter
 *    8   SSRC of the media
 *   12   'D' 'D' 'X' '1'
 *   16   highest: sequence number of the newest media packet that the receiver knows of, received or restored
 *   18   base: all packets before it have come or are given up
 *   20   missing: repair packets still needed for base to highest, less those that wait at the receiver
 *   22   loss of the last 2 s, media and repair packets, in 1/256
 *   23   flags: 1 = "highest repair" is valid
 *   24   highest repair: sequence number of the newest repair packet received
 *   26   age, in 0.25 ms: time since the newest of these packets arrived; 65535 = at least that
 *   28   reserved, 0: 4 bytes, which the sender ignores
 *
 * A report describes the whole state. So a lost report only costs time, and an old report is harmless.
 *
 * A picture loss indication (payload type 206, format 1) may come with it, or alone. Other RTCP packets are skipped:
 * players send them.
 */
#ifndef DDXVIDEO_REPORT_H
#define DDXVIDEO_REPORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define REPORT_WINDOW 256              /* packets: base is never further back than this */
#define REPORT_AHEAD 128               /* packets; highest may be further ahead than any sent packet by this */
#define REPORT_SIZE 32                 /* bytes of a report */
#define REPORT_MAX (REPORT_SIZE + 12)  /* bytes of what report_write() writes */
#define REPORT_TICK_NS INT64_C(250000) /* unit of the age */
#define REPORT_OLDEST_NS (65535 * REPORT_TICK_NS) /* this age means at least this */

struct report {
    uint32_t reporter, media; /* SSRCs */
    bool has_state;           /* there is a report: */
    uint16_t highest, base, missing;
    uint8_t loss;
    bool has_repair; /* highest_repair is valid */
    uint16_t highest_repair;
    int64_t age;  /* ns */
    bool refresh; /* there is a picture loss indication */
};

/* Write the report (if has_state) and the indication (if refresh) to to[REPORT_MAX]. Returns the number of bytes. */
size_t report_write(uint8_t *to, const struct report *report);

/*
 * 0; -EBADMSG if the datagram is not RTCP, or if the report cannot be true: base after highest or more than a window
 * before it, more missing than from base to highest, two reports, two reporters; -ENOMSG if it is RTCP without a report
 * or an indication.
 */
int report_parse(const uint8_t *data, size_t size, struct report *report);

#endif
