/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Private to the reader's files. */
#ifndef DDXLOG_READER_H
#define DDXLOG_READER_H

#include "record.h"

#define MCAP_IDS 65536
#define MCAP_PACKED_MAX (MCAP_CHUNK_MAX + (1 << 20)) /* bytes of a chunk's record: LZ4 enlarges random data a little */
#define MCAP_RECORD_MAX ((uint64_t)1 << 24)          /* of any other record */

/* The place of a chunk in the file. */
struct place {
    uint64_t offset, length; /* of the record's content in the file */
    uint64_t first, last;    /* log times */
    uint64_t unpacked;       /* declared size in bytes */
    unsigned number;         /* in the file */
    bool damaged;
};

/* A chunk in memory; or, with data NULL, one that must be unpacked when its next message is due. */
struct loaded {
    unsigned char *data;
    struct mcap_message *messages;
    size_t bytes; /* of both */
    size_t count, next;
    uint64_t time;   /* of message `next`; before unpacking, the declared time of the first message */
    unsigned number; /* of its place */
};

struct own_metadata {
    char *name;
    struct mcap_pair pairs[MCAP_PAIRS_MAX + 1];
};

struct own_channel {
    struct mcap_channel channel;
    struct mcap_pair pairs[MCAP_PAIRS_MAX + 1];
};

struct mcap_reader {
    int fd;
    uint64_t size;
    struct mcap_state state;
    struct place *places;
    unsigned place_count;
    struct own_metadata *metadata;
    unsigned metadata_count;
    size_t defined;    /* bytes of schemas, channels and metadata */
    struct loaded one; /* of mcap_chunk() */
    /* the order of messages: */
    unsigned *order; /* places by their first time */
    unsigned next;   /* in it */
    struct loaded *active;
    unsigned active_count;
    size_t active_bytes;
    bool delivered; /* the last call returned the earliest message */
    unsigned ids;   /* all ids are below this one */
    /* by id */
    struct mcap_schema *schemas[MCAP_IDS];
    struct own_channel *channels[MCAP_IDS];
};

/* Read all `size` bytes at this offset. 0; -EBADMSG: the file has fewer; -errno. */
int reader_read(const struct mcap_reader *reader, uint64_t offset, void *data, size_t size);

/* Store a Schema, Channel or Metadata record. -EBADMSG if it is invalid, -E2BIG beyond MCAP_DEFINED_MAX, -ENOMEM. */
int reader_define(struct mcap_reader *reader, enum mcap_opcode opcode, const unsigned char *content, size_t size);

/* Free all definitions. */
void reader_forget(struct mcap_reader *reader);

/* Count a record that exceeds a limit. */
void reader_refuse(struct mcap_reader *reader, uint64_t offset);

/* Read and unpack. 0, -EBADMSG, -E2BIG, -ENOMEM, -errno. */
int reader_load(struct mcap_reader *reader, const struct place *place, struct loaded *loaded);
void reader_unload(struct loaded *loaded);

#endif
