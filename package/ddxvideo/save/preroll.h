/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The last seconds before recording starts: pictures that wait in memory while nothing is recorded. */
#ifndef DDXVIDEO_PREROLL_H
#define DDXVIDEO_PREROLL_H

#include "ddxvideo.h"
#include "recording.h"

struct preroll {
    int64_t seconds;                  /* wanted; 0: none */
    const struct h264_settings *h264; /* pictures wait encoded; NULL: as they are */
    struct encode_load *load;         /* counts their encoding */
    /* private: */
    struct ddxvideo_geometry geometry; /* of its pictures */
    struct ddxvideo_picture *picture;  /* their planes are in `memory` */
    struct recording_frame *frame;
    unsigned char *memory;
    size_t bytes;                   /* of each; of all if they are encoded */
    struct coded_frames frames;     /* the encoder */
    struct coded_picture *coded;    /* encoded pictures, in `memory`; NULL: they are not encoded */
    size_t end;                     /* where the next one goes */
    struct recording_encoded taken; /* the last one that was taken out */
    unsigned limit, oldest, count;
    uint64_t missed; /* since the newest */
};

/* The encoder of the pictures that wait, for the recording that takes them. */
struct coded_frames *preroll_encoder(struct preroll *preroll);

/*
 * Seconds of such pictures, not encoded, that fit: they take three quarters of a queue of that number of frames.
 */
int64_t preroll_seconds_max(const struct ddxvideo_geometry *geometry, unsigned queue_frames);

/*
 * Keep a copy of a picture, and drop pictures that have become too old; drop all if they had another geometry. Returns
 * the number of dropped frames, with the frames missed before them, and with this one if there is no memory for it.
 */
uint64_t preroll_put(struct preroll *preroll, unsigned queue_frames, const struct ddxvideo_picture *view,
                     const struct recording_frame *frame);

/*
 * Account for frames that were missed before a frame that is not kept. If a picture waits, they count as missed before
 * the next one. Return the number of frames that are dropped instead: all, if no picture waits.
 */
uint64_t preroll_missed(struct preroll *preroll, uint64_t frames);

/*
 * Take out the oldest picture, which is valid until the next call that puts or takes. The first encoded one is a key
 * frame. False if there is none.
 */
bool preroll_take(struct preroll *preroll, struct ddxvideo_picture *view, struct recording_frame *frame);

/* How many frames were missed after the last picture. They are forgotten. */
uint64_t preroll_missed_last(struct preroll *preroll);

/* Drop all pictures and free the memory. Returns how many frames, as preroll_put(), and those missed since. */
uint64_t preroll_clear(struct preroll *preroll);

#endif
