/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * encode CLIP h264|mpeg4 KBIT: ddxvideosend's encoder alone. Encodes the clip's pictures from its own memory, each when
 * it is due, again and again until it is killed: no store, no packets, no network. What the sender takes beyond this is
 * the sender's.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "encoder.h"
#include "y4m.h"

#define FRAMES_MAX 1000
#define SECOND INT64_C(1000000000)
#define ROOM (RTP_PACKET_MAX - RTP_HEADER_MAX) /* as the sender's */

static struct ddxvideo_picture picture[FRAMES_MAX];

static int fail(const char *what, const char *why) {
    fprintf(stderr, "encode: %s: %s\n", what, why);
    return 1;
}

/* All pictures of the clip; how many, 0 if it cannot be read. */
static unsigned load(const char *path, struct y4m_reader *reader) {
    unsigned count = 0;
    if (y4m_open(reader, path) != Y4M_OK)
        return 0;
    for (int64_t time; count < FRAMES_MAX; count++) {
        unsigned char *plane[3];
        for (int i = 0; i < 3; i++) {
            plane[i] = malloc(y4m_plane_bytes(&reader->header, i));
            picture[count].plane[i] = plane[i];
            picture[count].stride[i] = reader->header.geometry.width / (i ? 2 : 1);
        }
        if (!plane[0] || !plane[1] || !plane[2] || y4m_read(reader, plane, &time) != Y4M_OK)
            break;
    }
    return count;
}

int main(int argc, char **argv) {
    static struct y4m_reader reader;
    struct encoder encoder;
    if (argc != 4 || (strcmp(argv[2], "h264") != 0 && strcmp(argv[2], "mpeg4") != 0))
        return fail("usage", "encode CLIP h264|mpeg4 KBIT");
    unsigned count = load(argv[1], &reader);
    const struct ddxvideo_geometry *geometry = &reader.header.geometry;
    if (!count || !geometry->rate_num)
        return fail(argv[1], count ? "no frame rate" : reader.error);
    av_log_set_level(AV_LOG_ERROR);
    int error = encoder_open(&encoder, *argv[2] == 'h' ? RTP_H264 : RTP_MPEG4, geometry, atol(argv[3]) * 1000, ROOM);
    if (error)
        return fail("encoder", av_err2str(error));
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (unsigned number = 0;; number = (number + 1) % count) {
        const AVPacket *packet;
        error = encoder_encode(&encoder, &picture[number], &packet);
        if (error)
            return fail("encoder", av_err2str(error));
        int64_t next = due.tv_nsec + SECOND * geometry->rate_den / geometry->rate_num;
        due.tv_sec += next / SECOND;
        due.tv_nsec = next % SECOND;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }
}
