/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * MCAP, a container format of robotics (https://mcap.dev/spec): a writer and a reader of the part that a log needs.
 *
 * The writer's files: magic, Header, Metadata; then repeatedly new Schema and Channel records, a Chunk of messages
 * (LZ4) and its Message Indexes; at the end Data End, the summary (schemas and channels again, statistics, indexes), a
 * Footer, magic. Schemas and channels are before the chunks, not in them, so that they are found without unpacking. A
 * truncated file is read up to its last whole chunk. Messages outside chunks are ignored: they have no checksum, so
 * damaged bytes might look like one.
 *
 * Errors: -errno. Times: ns of the caller's clock. A writer, or a reader, belongs to one thread at a time.
 */
#ifndef DDXLOG_MCAP_H
#define DDXLOG_MCAP_H

#include "bytes.h"

/* A key and its value; arrays of them end with a NULL key. */
struct mcap_pair {
    const char *key, *value;
};

#define MCAP_PAIRS_MAX 16 /* of a channel, or of a metadata record, that the reader keeps */

/*
 * Limits, in bytes. A few megabytes of LZ4 may declare gigabytes, so the reader refuses a chunk of more than
 * MCAP_CHUNK_MAX; a message of up to MCAP_MESSAGE_MAX fits into a chunk, packed or not.
 */
#define MCAP_CHUNK_USUAL ((size_t)1 << 20)  /* a writer flushes a chunk of this size */
#define MCAP_CHUNK_MAX ((uint64_t)64 << 20) /* of one chunk, unpacked */
#define MCAP_MESSAGE_MAX ((size_t)63 << 20) /* of one message */
#define MCAP_OPEN_MAX ((size_t)64 << 20)    /* of all chunks that mcap_next() keeps unpacked */
#define MCAP_DEFINED_MAX ((size_t)32 << 20) /* of all schemas, channels and metadata of a file */

struct mcap_schema {
    uint16_t id; /* 0: none */
    const char *name, *encoding;
    const unsigned char *data;
    size_t size;
};

struct mcap_channel {
    uint16_t id;
    uint16_t schema;
    const char *topic, *encoding;
    const struct mcap_pair *metadata;
};

struct mcap_message {
    uint16_t channel;
    uint32_t sequence;
    uint64_t log_time, publish_time;
    const unsigned char *data;
    size_t size;
};

/* ---- Writing ---- */

struct mcap_writer;

/*
 * Begin a file on this descriptor. The file must be empty; it is only written at its end, by mcap_flush() and
 * mcap_finish(). The descriptor remains the caller's. NULL: no memory.
 */
struct mcap_writer *mcap_writer_new(int fd);
void mcap_writer_free(struct mcap_writer *writer);

/* These functions copy their arguments. They fail only without memory, which mcap_flush() reports. */
void mcap_put_metadata(struct mcap_writer *writer, const char *name, const struct mcap_pair *pairs);
/* Ids are consecutive, from 1. */
void mcap_put_schema(struct mcap_writer *writer, const struct mcap_schema *schema);
void mcap_put_channel(struct mcap_writer *writer, const struct mcap_channel *channel);
/* Append to the current chunk; mcap_pending() returns its unpacked size. */
void mcap_put_message(struct mcap_writer *writer, const struct mcap_message *message);
/* The same with room for `size` bytes of data, which the caller fills at once. NULL: no memory. */
unsigned char *mcap_put_message_space(struct mcap_writer *writer, const struct mcap_message *message);
size_t mcap_pending(const struct mcap_writer *writer);

/*
 * Pack the chunk and write all new records to the file. After a failure (-ENOSPC, ...) the file is whole only up to
 * mcap_written(), where the caller may truncate it; nothing more is written to it.
 */
int mcap_flush(struct mcap_writer *writer);
uint64_t mcap_written(const struct mcap_writer *writer);

/* mcap_flush(), then the summary and the end of the file. */
int mcap_finish(struct mcap_writer *writer);

/* ---- Reading ---- */

#define MCAP_ERROR_MAX 200

struct mcap_reader;

/* The state of a file. */
struct mcap_state {
    bool complete;       /* not truncated, and no longer being written */
    unsigned chunks;     /* number found */
    unsigned damaged;    /* chunks that could not be unpacked so far: their messages are missing */
    unsigned refused;    /* records that exceed a limit: the chunks among them count as damaged, others are ignored */
    uint64_t refused_at; /* offset of the first of them in the file */
    uint64_t left_over;  /* bytes after the last whole record of a truncated file */
};

/*
 * Open a file and scan its records; chunks are unpacked later. Never changes the file. NULL, and one clear text in
 * error[MCAP_ERROR_MAX], if it is not MCAP or cannot be read. The caller owns the reader, until mcap_close().
 */
struct mcap_reader *mcap_open(const char *path, char *error);
void mcap_close(struct mcap_reader *reader);
struct mcap_state mcap_state(const struct mcap_reader *reader);
/* A message about refused records in text[MCAP_ERROR_MAX]. False: there are none. */
bool mcap_refused_text(const struct mcap_state *state, char *text);

/* By id; NULL if the file has none (so far). Valid until mcap_close(). */
const struct mcap_schema *mcap_schema(const struct mcap_reader *reader, uint16_t id);
const struct mcap_channel *mcap_channel(const struct mcap_reader *reader, uint16_t id);
/* The value of a key of the first metadata record of this name, of a channel; NULL if there is none. */
const char *mcap_metadata(const struct mcap_reader *reader, const char *name, const char *key);
const char *mcap_value(const struct mcap_channel *channel, const char *key);
/* The i-th metadata record, from 0: its name, and its pairs. NULL past the last. */
const char *mcap_metadata_at(const struct mcap_reader *reader, unsigned index, const struct mcap_pair **pairs);

/* The earliest and the latest log time, according to the chunks; 0 and 0 if there is no message. */
void mcap_times(const struct mcap_reader *reader, uint64_t *first, uint64_t *last);

/*
 * The next message in the order of log times; messages with equal times in the order of the file. 1; 0 at the end;
 * -errno. Damaged chunks are skipped and counted. The data are valid until the next call. If more chunks overlap in
 * time than MCAP_OPEN_MAX allows, some are unpacked more than once: such a file takes time, not memory.
 */
int mcap_next(struct mcap_reader *reader, struct mcap_message *message);
/* Begin again with the first message. */
void mcap_rewind(struct mcap_reader *reader);

/*
 * All messages of chunk `index`, from 0, in the order of the file: an array that is valid until the next call of any
 * function of this reader. Returns their number; -EBADMSG: damaged; -ENOENT: no such chunk; other -errno.
 */
long mcap_chunk(struct mcap_reader *reader, unsigned index, const struct mcap_message **messages);

#endif
