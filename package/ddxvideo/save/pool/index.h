/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The index beside each file of the pool: the state of the file, and for each frame its place, time, number and
 * checksum, and the losses before it. A frame in the index is on the disk, since the index is written after the frames.
 *
 * The file, little endian: a header of INDEX_BLOCK bytes, then entries of 64 bytes, INDEX_BYTES in all, written in full
 * before its first use, so that later only its bytes change, and no metadata. Entries have the recording's random
 * number, which distinguishes them from entries of an earlier recording, which may follow.
 */
#ifndef DDXVIDEO_INDEX_H
#define DDXVIDEO_INDEX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define INDEX_BLOCK 4096u
#define INDEX_BYTES (1u << 20)
#define INDEX_ENTRIES ((INDEX_BYTES - INDEX_BLOCK) / sizeof(struct index_entry))
#define INDEX_MAGIC "DDXINDX1"

enum index_state {
    INDEX_RAW,       /* its file must be written in full before use */
    INDEX_FREE,      /* ready */
    INDEX_RECORDING, /* in use; or it was, when the power failed */
    INDEX_FINISHED,  /* a recording of `bytes` bytes, perhaps without a name yet */
    INDEX_NAMED      /* it was given its name: if it has none now, it was deleted */
};

#define INDEX_RECOVERED 1u /* finished by a later recorder, after a kill or a power cut */
#define INDEX_HEAD 2u      /* `head` is valid; older recorders did not write it */

enum { INDEX_Y4M, INDEX_MP4 }; /* format of the file */

#define INDEX_KEY 1u /* a key frame of an MP4 file */

/* Offset 0 of the index. */
struct index_header {
    char magic[8];
    uint32_t state;      /* enum index_state */
    uint32_t frames;     /* finished: number of frames */
    uint64_t recording;  /* random number of this segment */
    uint64_t bytes;      /* finished: bytes of the file */
    int64_t start;       /* first frame: CLOCK_MONOTONIC, ns */
    int64_t wall;        /* and CLOCK_REALTIME, ns; 0 if unknown */
    uint64_t lost_store; /* finished: missing frames, by reason */
    uint64_t lost_ring;
    uint32_t number;   /* of the segment, among those of the item */
    uint32_t session;  /* number of the segment that this one continues, or its own */
    char item[64];     /* these three end with a 0 byte */
    char instance[64]; /* of the recorder; "" if an older recorder wrote the index */
    char name[192];    /* of the finished recording */
    uint32_t flags;    /* INDEX_RECOVERED, INDEX_HEAD */
    uint16_t format;
    uint16_t lost_encode; /* finished: missing frames, because the encoder failed; UINT16_MAX stands for more, too */
    uint32_t head; /* CRC-32C of the bytes before the first frame: Y4M's first line, or block 0 as first written */
    uint32_t crc;  /* of all before */
};

struct index_entry {
    uint64_t recording;
    uint64_t sequence;              /* in the store */
    int64_t time;                   /* of the capture, CLOCK_MONOTONIC, ns */
    uint64_t offset;                /* in the file, of its FRAME line or fragment */
    uint32_t bytes;                 /* line and picture, or the whole fragment */
    uint32_t sum;                   /* CRC-32C of these bytes */
    uint32_t position;              /* in the segment, from 0 */
    int32_t frame;                  /* the source's number */
    uint32_t lost_store, lost_ring; /* frames lost before this one */
    uint16_t flags;                 /* INDEX_KEY */
    uint16_t lost_encode;           /* as the two above; UINT16_MAX stands for more, too */
    uint32_t crc;                   /* of all before */
};

/* The whole index, as on the disk. */
struct index_file {
    struct index_header header;
    unsigned char rest[INDEX_BLOCK - sizeof(struct index_header)];
    struct index_entry entry[(INDEX_BYTES - INDEX_BLOCK) / sizeof(struct index_entry)];
};

/* Set the checksum, after all other fields. */
void index_seal_header(struct index_header *header);
void index_seal_entry(struct index_entry *entry);

/* Whether it is valid. */
bool index_good_header(const struct index_header *header);
bool index_good_entry(const struct index_entry *entry, uint64_t recording, uint32_t position);

/*
 * How many entries from the first on are without a gap, and within the first `limit` bytes of the file.
 */
uint32_t index_count(const struct index_file *index, uint64_t limit);

/* End the recording after these frames, at least one: sets state, size and losses in the header. An MP4 file's table
 * is not part of that size. Seal it then. */
void index_end(struct index_file *index, uint32_t frames);

/* The sum of two counts, for fields of 16 bits. */
uint16_t index_lost(uint16_t before, uint64_t more);

/* Read all of it. 0; -EBADMSG: not an index; or -errno. */
int index_read(int fd, struct index_file *index);

#endif
