/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Reads MP4 files that mp4_write.h describes, and no others; each byte of their boxes is compared. */
#ifndef DDXVIDEO_MP4_READ_H
#define DDXVIDEO_MP4_READ_H

#include "mp4_write.h"

#define MP4_FOREIGN "an MP4 file, but not one of ddxvideosave; make a Y4M file: ffmpeg -i FILE -pix_fmt yuv420p OUT.y4m"

/* Whether a regular file begins as an MP4 file does, of any program. Its position stays. */
bool mp4_is_any(int fd);

/* Parse block 0; *end: where the table begins, 0 if the file is not finished. False: not a file of ours. */
bool mp4_read_head(const uint8_t block[MP4_BLOCK], struct mp4_format *format, uint64_t *end);

/* The content of `avcC` in a block 0 that mp4_write_head() wrote: a decoder takes the parameter sets in this form. */
const uint8_t *mp4_decoder_record(const uint8_t block[MP4_BLOCK], size_t *size);

/* Parse the begin of a fragment. False if it is none. Its time and size are those in the file, whatever they are. */
bool mp4_read_fragment(const uint8_t from[MP4_FRAGMENT], struct mp4_fragment *fragment);

/* A file's frames, one after the other. */
struct mp4_file {
    int fd;
    uint64_t size;
    struct mp4_format format;
    uint64_t end;    /* where the table begins; 0: not finished */
    uint64_t at;     /* of the next fragment */
    uint32_t frames; /* so far */
    uint64_t time;   /* of the last one */
};

/* Read block 0 of a regular file, which stays the caller's. 0, -EBADMSG (not a file of ours), or -errno. */
int mp4_open(struct mp4_file *file, int fd);

enum mp4_next {
    MP4_FRAME,  /* mp4_read_bytes() has its bytes */
    MP4_END,    /* the last frame was the last one, whole */
    MP4_CUT,    /* an unfinished file ends within a frame, or in a table; a finished one before its table */
    MP4_DAMAGED /* another thing is where a frame should begin, or a frame has an impossible time */
};

/* The next whole frame. Anything else leaves `file->at` after the last whole one. */
enum mp4_next mp4_next_frame(struct mp4_file *file, struct mp4_fragment *fragment);

/* The bytes of the frame that mp4_next_frame() gave last. 0; -ENODATA: the file became shorter; or -errno. */
int mp4_read_bytes(const struct mp4_file *file, const struct mp4_fragment *fragment, uint8_t *to);

/* The last frame of a finished file, found through its table. False: not finished, or its table is not one of ours. */
bool mp4_last_frame(const struct mp4_file *file, struct mp4_fragment *fragment);

/* Back to the first frame. */
void mp4_rewind(struct mp4_file *file);

/*
 * All whole frames from the beginning, for mp4_finish(); the caller frees them. Returns their number, and in *last what
 * follows them; or -ENOMEM.
 */
int64_t mp4_entries(struct mp4_file *file, struct mp4_entry **entries, enum mp4_next *last);

#endif
