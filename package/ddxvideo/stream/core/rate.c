/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "rate.h"

#include <math.h>

#include "rtp.h"
#include "tuning.h"

/* ---- The rate ---- */

/* Sets the rate at which the bucket fills. While it is lower than -wire, the bucket holds less: its bytes would only
 * wait in the link's queue. */
static void set_rate(const struct link_rate *link, struct budget *budget, double rate) {
    double most = (double)link->wire, least = fmax(tuning.link_least_bits, most * tuning.link_least_share);
    int64_t packet = (int64_t)(2 * RTP_PACKET_MAX * 8 * (double)SECOND / rate);

    rate = rate > most ? most : rate < least ? least : rate;
    budget->rate = (int64_t)rate;
    budget->depth = rate >= most ? tuning.bucket : packet > tuning.link_bucket ? packet : tuning.link_bucket;
    if (budget->depth > tuning.bucket)
        budget->depth = tuning.bucket;
}

/* A little less than what arrives, so that the queue drains. Without a queue the rate rises again, more slowly where
 * the link was full before. */
void link_rate_follow(struct link_rate *link, struct budget *budget, const struct deficit *nearest, int64_t now) {
    double rate = (double)budget->rate;

    if (!nearest || now - link->followed < tuning.link_step)
        return;
    if (nearest->link > 0) {
        link->link = nearest->link;
        link->followed = now;
        if (rate > tuning.link_drain * link->link)
            set_rate(link, budget, fmax(tuning.link_drain * link->link, tuning.link_fall * rate));
    } else if (nearest->queue < tuning.queue / 2 && budget->rate < link->wire) {
        bool near = rate > tuning.link_near_least * link->link && rate < tuning.link_near_most * link->link;

        link->followed = now;
        set_rate(link, budget, rate * (near ? tuning.link_rise_slowly : tuning.link_rise));
    }
}

/* Whether packets stay away. That can be forged, so it counts until the rate must have followed, and not for ever. */
static bool is_held(struct link_rate *link, const struct deficit *nearest, int64_t now) {
    if (!nearest->held)
        return false;
    if (now - link->held_last > tuning.link_held_apart)
        link->held_first = now;
    link->held_last = now;
    return now - link->held_first <= tuning.link_held_most;
}

bool link_rate_is_full(struct link_rate *link, const struct deficit *nearest, const struct history *sent, int64_t now) {
    int64_t more = nearest && nearest->loss > tuning.margin_loss ? tuning.link_full_more : 0;
    bool full = nearest &&
                (is_held(link, nearest, now) || nearest->queue > tuning.link_full + more ||
                 (nearest->delay > tuning.link_full_now + more && history_sent(sent, sent->newest) > nearest->arrival));

    link->was_full |= full;
    if (full)
        link->full = now;
    return full;
}

bool link_rate_was_full(const struct link_rate *link, int64_t now) {
    return link->was_full && now - link->full < tuning.link_full_after;
}

/* ---- The number of frames ---- */

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
