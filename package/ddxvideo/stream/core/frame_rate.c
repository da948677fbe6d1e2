/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "frame_rate.h"

#include "tuning.h"

void frame_rate_init(struct frame_rate *rate, int64_t now) {
    *rate = (struct frame_rate){.every = 1, .changed = now};
}

void frame_rate_reset(struct frame_rate *rate, int64_t now) {
    if (rate->every > 1)
        frame_rate_init(rate, now);
}

static void change(struct frame_rate *rate, int64_t now, int step) {
    rate->every += (unsigned)step;
    rate->changed = now;
}

void frame_rate_learn(struct frame_rate *rate, int64_t now, double bytes, double fair, double loss) {
    rate->bytes = rate->begun ? rate->bytes + (bytes - rate->bytes) / tuning.rate_frames : bytes;
    rate->begun = true;
    if (rate->every < tuning.rate_every_most && loss > tuning.rate_loss && rate->bytes * rate->every < fair &&
        now - rate->changed > tuning.rate_lower_after)
        change(rate, now, 1);
    else if (rate->every > 1 &&
             (loss < tuning.rate_loss / 2 || rate->bytes * (rate->every - 1) > tuning.rate_rise * fair) &&
             now - rate->changed > tuning.rate_raise_after)
        change(rate, now, -1);
}

bool frame_rate_leaves_out(struct frame_rate *rate) {
    return ++rate->turn < rate->every;
}

void frame_rate_sends(struct frame_rate *rate) {
    rate->turn = 0;
}
