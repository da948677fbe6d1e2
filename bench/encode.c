/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * encode CLIP h264|ultrafast|mpeg4 KBIT [FILE]: ddxvideosend's encoder alone (ultrafast: H.264 with that preset).
 * Encodes the clip's pictures from its own memory, each when it is due, again and again until it is killed: no store,
 * no packets, no network. What the sender takes beyond this is the sender's. With FILE: each picture once, without
 * pauses, into that file; the CPU time that they took goes to standard output.
 */
#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "due.h"
#include "encoder.h"
#include "y4m.h"

#define FRAMES_MAX 1000

static struct ddxvideo_picture picture[FRAMES_MAX];

static int fail(const char *what, const char *why) {
    fprintf(stderr, "encode: %s: %s\n", what, why);
    return 1;
}

/* All pictures of the clip; how many, 0 if it cannot be read. */
static unsigned load(const char *path, struct y4m_reader *reader) {
    unsigned count = 0;
    if (y4m_open(reader, path, DDX_VIDEO_420) != Y4M_OK)
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

/* The next picture, renewed as often as by the sender without loss. */
static int encode(struct encoder *encoder, unsigned number, unsigned count, struct encoded *encoded) {
    const struct ddxvideo_geometry *geometry = &encoder->geometry;
    unsigned period = (unsigned)(ENCODER_RENEWAL_SECONDS * geometry->rate_num / geometry->rate_den);

    if (encoder->type == RTP_H264 && period && number && number % period == 0)
        encoder_refresh(encoder, false);
    return encoder_encode(encoder, &picture[number % count], 0, encoded);
}

static int encode_for_ever(struct encoder *encoder, unsigned count) {
    struct encoded encoded;
    struct timespec due;

    clock_gettime(CLOCK_MONOTONIC, &due);
    for (unsigned number = 0;; number++) {
        int error = encode(encoder, number, count, &encoded);
        if (error)
            return fail("encoder", av_err2str(error));
        wait_until_due(&due, &encoder->geometry);
    }
}

static int encode_once(struct encoder *encoder, unsigned count, const char *path) {
    struct encoded encoded;
    uint64_t bytes = 0;
    FILE *file = fopen(path, "we");
    int error = 0;

    if (!file)
        return fail(path, strerror(errno));
    clock_t begin = clock();
    for (unsigned number = 0; number < count && !error; number++) {
        error = encode(encoder, number, count, &encoded);
        if (!error)
            bytes += fwrite(encoded.data, 1, encoded.size, file);
    }
    printf("{\"frames\":%u,\"bytes\":%" PRIu64 ",\"cpu_us\":%.0f}\n", count, bytes,
           (double)(clock() - begin) / CLOCKS_PER_SEC * 1e6);
    if (error)
        fail("encoder", av_err2str(error));
    return fclose(file) || error;
}

int main(int argc, char **argv) {
    static struct y4m_reader reader;
    static struct encoder encoder;
    if (argc < 4 || argc > 5 || (strcmp(argv[2], "h264") && strcmp(argv[2], "ultrafast") && strcmp(argv[2], "mpeg4")))
        return fail("usage", "encode CLIP h264|ultrafast|mpeg4 KBIT [FILE]");
    unsigned count = load(argv[1], &reader);
    const struct ddxvideo_geometry *geometry = &reader.header.geometry;
    if (!count || !geometry->rate_num)
        return fail(argv[1], count ? "no frame rate" : reader.error);
    av_log_set_level(AV_LOG_FATAL);
    const struct encoder_settings settings = {
        .type = *argv[2] == 'm' ? RTP_MPEG4 : RTP_H264, .bitrate = atol(argv[3]) * 1000, .fast = *argv[2] == 'u'};
    int error = encoder_open(&encoder, &settings, geometry);
    if (error)
        return fail("encoder", av_err2str(error));
    return argc == 5 ? encode_once(&encoder, count, argv[4]) : encode_for_ever(&encoder, count);
}
