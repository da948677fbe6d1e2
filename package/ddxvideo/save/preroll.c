/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "preroll.h"

#include <stdlib.h>

#include "ddx_time.h"
#include "program.h"
#include "video_layout.h"

#define USUAL_RATE 25 /* of a source without a known rate */

static unsigned limit_of(unsigned queue_frames) {
    return queue_frames > 4 ? queue_frames / 4 * 3 : 1;
}

int64_t preroll_seconds_max(const struct ddxvideo_geometry *geometry, unsigned queue_frames) {
    int64_t frames = limit_of(queue_frames);

    return geometry->rate_num > 0 && geometry->rate_den > 0 ? frames * geometry->rate_den / geometry->rate_num
                                                            : frames / USUAL_RATE;
}

static uint64_t drop_oldest(struct preroll *preroll) {
    uint64_t frames = 1 + preroll->frame[preroll->oldest].missed;

    preroll->oldest = (preroll->oldest + 1) % preroll->limit;
    preroll->count--;
    return frames;
}

uint64_t preroll_missed_last(struct preroll *preroll) {
    uint64_t frames = preroll->missed;

    preroll->missed = 0;
    return frames;
}

uint64_t preroll_missed(struct preroll *preroll, uint64_t frames) {
    if (!preroll->count)
        return frames;
    preroll->missed += frames;
    return 0;
}

uint64_t preroll_clear(struct preroll *preroll) {
    uint64_t frames = preroll_missed_last(preroll);

    while (preroll->count)
        frames += drop_oldest(preroll);
    free(preroll->picture);
    free(preroll->frame);
    free(preroll->memory);
    *preroll = (struct preroll){.seconds = preroll->seconds};
    return frames;
}

/* Makes room for pictures of this geometry. */
static bool set_up(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view) {
    preroll->limit = limit_of(queue_frames);
    preroll->picture = calloc(preroll->limit, sizeof *preroll->picture);
    preroll->frame = calloc(preroll->limit, sizeof *preroll->frame);
    preroll->bytes = video_layout_bytes(&view->geometry);
    preroll->memory = malloc(preroll->limit * preroll->bytes); /* unused memory costs nothing */
    preroll->geometry = view->geometry;
    if (preroll->seconds > preroll_seconds_max(&view->geometry, queue_frames))
        say("%lld seconds before the start do not fit into memory, only the last %u frames do",
            (long long)preroll->seconds, preroll->limit);
    if (preroll->picture && preroll->frame && preroll->memory)
        return true;
    say("no memory for %lld seconds before the start", (long long)preroll->seconds);
    preroll->seconds = 0;
    preroll_clear(preroll);
    return false;
}

uint64_t preroll_put(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view,
                     const struct recording_frame *frame) {
    uint64_t gone = 0;

    if (preroll->memory && (!preroll->seconds || !ddxvideo_same_layout(&preroll->geometry, &view->geometry)))
        gone = preroll_clear(preroll);
    if (!preroll->seconds || (!preroll->memory && !set_up(preroll, queue_frames, view)))
        return gone + 1 + frame->missed;
    while (preroll->count && (preroll->count == preroll->limit ||
                              frame->published - preroll->frame[preroll->oldest].published > preroll->seconds * SECOND))
        gone += drop_oldest(preroll);
    unsigned at = (preroll->oldest + preroll->count++) % preroll->limit;
    video_layout_copy(&preroll->picture[at], view, preroll->memory + at * preroll->bytes);
    preroll->frame[at] = *frame;
    preroll->frame[at].missed += preroll_missed_last(preroll);
    return gone;
}

bool preroll_take(struct preroll *preroll, struct ddxvideo_picture *view, struct recording_frame *frame) {
    if (!preroll->count)
        return false;
    *view = preroll->picture[preroll->oldest];
    *frame = preroll->frame[preroll->oldest];
    drop_oldest(preroll);
    return true;
}
