/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * h264 CLIP QUALITY: x264 alone, with the recorder's settings. Encodes the clip's pictures from its own memory, each
 * when it is due, a key frame each second, again and again until it is killed: no store, no file. The difference to the
 * recorder's processor time is the recorder's own.
 */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "clip.h"
#include "due.h"
#include "h264_encode.h"
#include "video_layout.h"

#define FRAMES_MAX 1000

static struct ddxvideo_picture picture[FRAMES_MAX];

static int fail(const char *what, const char *why) {
    fprintf(stderr, "h264: %s: %s\n", what, why);
    return 1;
}

/* All pictures of the clip; how many. */
static unsigned load(struct clip *clip) {
    unsigned count = 0;

    for (int64_t time; count < FRAMES_MAX; count++) {
        unsigned char *memory = malloc(video_layout_bytes(&clip->geometry));

        picture[count].geometry = clip->geometry;
        if (!memory)
            break;
        video_layout_place(&picture[count], memory);
        unsigned char *const planes[3] = {memory, memory + (picture[count].plane[1] - memory),
                                          memory + (picture[count].plane[2] - memory)};
        if (clip_read(clip, planes, &time) != CLIP_OK)
            break;
    }
    return count;
}

int main(int argc, char **argv) {
    static struct clip clip;
    static struct h264_encoder encoder;
    struct mp4_format format;
    struct timespec due;
    const uint8_t *data;
    size_t size;

    if (argc != 3)
        return fail("usage", "h264 CLIP QUALITY");
    if (clip_open(&clip, argv[1], Y4M_SAME) != CLIP_OK)
        return fail(argv[1], clip.error);
    const struct h264_settings settings = {.quality = atol(argv[2])};
    unsigned count = load(&clip);
    if (!count || !clip.geometry.rate_num || h264_encoder_open(&encoder, &clip.geometry, &settings, &format))
        return fail(argv[1], "cannot be encoded");
    int second = clip.geometry.rate_num / clip.geometry.rate_den;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (unsigned number = 0;; number++) {
        if (h264_encode(&encoder, &picture[number % count], !(number % (unsigned)second), &data, &size))
            return fail(argv[1], "the encoder failed");
        wait_until_due(&due, &clip.geometry);
    }
}
