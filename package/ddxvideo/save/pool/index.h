/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * The index beside each file of the pool: what the file is, and of each frame where it is, when and which it was, its
 * checksum and what was lost before it. What stands in the index is on the disk: it is written after the frames.
 *
 * The file, little endian: a header of INDEX_BLOCK bytes, then entries of 64 bytes, INDEX_BYTES in all, written once
 * before it is used, so that nothing but its bytes changes later. Entries hold the recording's random number, so
 * that entries of an earlier recording, which may follow them, are not taken for its own.
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
    INDEX_RAW,       /* its file has to be written in full before it may be used */
    INDEX_FREE,      /* ready */
    INDEX_RECORDING, /* in use; or was, when the power went */
    INDEX_FINISHED,  /* a recording of `bytes` bytes, which may lack its name */
    INDEX_NAMED      /* one that has had its name: without a name it has been deleted */
};

#define INDEX_RECOVERED 1u /* finished by a later recorder: its own was killed, or the power went */
#define INDEX_HEAD 2u      /* `head` is there: not in what older recorders wrote */

/* Offset 0 of the index. */
struct index_header {
    char magic[8];
    uint32_t state;      /* enum index_state */
    uint32_t frames;     /* finished: how many */
    uint64_t recording;  /* random, of this segment */
    uint64_t bytes;      /* finished: of the file */
    int64_t start;       /* first frame: CLOCK_MONOTONIC, ns */
    int64_t wall;        /* and CLOCK_REALTIME, ns; 0 if unknown */
    uint64_t lost_store; /* finished: frames that are missing, by reason */
    uint64_t lost_ring;
    uint32_t number; /* of the segment, among those of the item */
    uint32_t session; /* number of the segment that this one continues, or its own */
    char item[64];     /* these three end with a 0 byte */
    char instance[64]; /* of the recorder; "" in an index of a recorder that did not say that yet */
    char name[192];    /* under which the finished recording is found */
    uint32_t flags;    /* INDEX_RECOVERED, INDEX_HEAD */
    uint32_t reserved;
    uint32_t head; /* CRC-32C of the file's first line, which lies before its first frame */
    uint32_t crc; /* of all before */
};

struct index_entry {
    uint64_t recording;
    uint64_t sequence; /* in the store */
    int64_t time;      /* of the capture, CLOCK_MONOTONIC, ns */
    uint64_t offset;   /* of its FRAME line in the file */
    uint32_t bytes;    /* line and picture */
    uint32_t sum;      /* CRC-32C of these bytes */
    uint32_t position; /* in the segment, from 0 */
    int32_t frame;     /* the source's number */
    uint32_t lost_store, lost_ring; /* frames lost before this one */
    uint32_t reserved;
    uint32_t crc; /* of all before */
};

/* The whole index, as on the disk. */
struct index_file {
    struct index_header header;
    unsigned char rest[INDEX_BLOCK - sizeof(struct index_header)];
    struct index_entry entry[(INDEX_BYTES - INDEX_BLOCK) / sizeof(struct index_entry)];
};

/* Write the checksum, after the rest. */
void index_seal_header(struct index_header *header);
void index_seal_entry(struct index_entry *entry);

/* Whether it is one, unspoilt. */
bool index_good_header(const struct index_header *header);
bool index_good_entry(const struct index_entry *entry, uint64_t recording, uint32_t position);

/*
 * How many entries follow each other without a gap, from the first, within the first `limit` bytes of the file.
 */
uint32_t index_count(const struct index_file *index, uint64_t limit);

/* The recording ends after these frames, at least one: state, size and losses in the header say so. Not sealed yet. */
void index_end(struct index_file *index, uint32_t frames);

/* Read all of it: 0, -EBADMSG when it is not one, or -errno. */
int index_read(int fd, struct index_file *index);

#endif
