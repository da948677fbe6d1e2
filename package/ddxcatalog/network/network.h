/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Publishing and subscribing by DDS. Only the files of this folder depend on its implementation.
 *
 * All functions return 0 or -errno, none waits for the network. A writer may be used by one thread, all other objects
 * by the thread that opened the network.
 */
#ifndef DDXCATALOG_NETWORK_H
#define DDXCATALOG_NETWORK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bucket.h"
#include "description.h"

#define NETWORK_PEERS 16
#define NETWORK_MACHINES 32 /* most other machines known at a time */
#define NETWORK_ITEMS 256   /* of one machine */
#define NETWORK_TEXT 16384  /* bytes of a declaration or of extents, with the 0 byte */

struct network_options {
    unsigned domain;
    const char *interface;            /* NULL: chosen automatically, not the loopback interface */
    const char *peers[NETWORK_PEERS]; /* addresses that are contacted one by one, ended by NULL */
    bool unicast;                     /* use no multicast */
    struct bucket *bucket;            /* the limit of all sent bytes; NULL: none. It outlives the network */
};

struct network;
struct network_writer;
struct network_reader;

/* An event. network_wait() calls `ready`. */
struct network_event {
    void (*ready)(void *argument);
    void *argument;
};

/* -EINVAL: a name that cannot be an interface or an address; -EADDRNOTAVAIL: no such interface, or no network. */
int network_open(const struct network_options *options, struct network **network);

/* Whether this machine has lost an address that it had when the network was opened. Then open the network again. */
bool network_moved(const struct network *network);

/*
 * Writers that are closed later wait until one second from now for their readers to confirm all messages; without this
 * call, they do not wait.
 */
void network_linger(struct network *network);

/* The caller closes readers and writers before. NULL is allowed. */
void network_close(struct network *network);

/*
 * Wait for an event, `seconds` at most, and let the owners of the events act. All they read then is bounded, so this
 * returns soon also while another machine sends without end; records and clocks then get a quarter of the time.
 */
void network_wait(struct network *network, double seconds);

/* ---- Values: messages in CDR ---- */

/*
 * Open a writer for messages of up to `size` bytes; `event`, which must outlive it, is for readers that come or leave.
 * `latched`: keep the newest value for readers that come later.
 * -EINVAL: a type that cannot be described; -ENOMEM.
 */
int network_writer_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        bool latched, const struct network_event *event, struct network_writer **writer);
void network_writer_close(struct network_writer *writer);

/* The number of readers; *came: number of readers that have come since the last call. */
unsigned network_writer_readers(struct network_writer *writer, unsigned *came);

/*
 * Send a message. `wall`: its time, ns of wall time. The caller provides room for four bytes after message[size], which
 * are overwritten. -EAGAIN: sending would have to wait, since the limit of bytes does not allow it now, or readers have
 * not confirmed earlier messages; -EINVAL.
 */
int network_write(struct network_writer *writer, unsigned char *message, size_t size, int64_t wall);

/* Open a reader for these messages; `event` is for received messages. */
int network_reader_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        const struct network_event *event, struct network_reader **reader);
void network_reader_close(struct network_reader *reader);

/*
 * Call `take` for each received message, in order. `writer` identifies the writer that sent it. If there are many
 * messages, the event comes again for the rest.
 */
typedef void network_take(void *argument, uint64_t writer, const unsigned char *message, size_t size);
void network_read(struct network_reader *reader, network_take *take, void *argument);

/* ---- Records of machines and items: kept for machines that come later ---- */

/* An item of a machine, or the machine itself (item ""). From the network, fields may have any content. */
struct network_record {
    uint64_t machine; /* with `item`, the key */
    char *item;
    char *name;    /* of the machine */
    int64_t since; /* start of the machine's catalog, ns of its wall time; never after padding */
    char *host;    /* its host name, which differs from `name` if two machines have the same host name */
    char *boot;    /* boot id, which identifies the boot that CLOCK_MONOTONIC belongs to */
    char *type, *declaration, *extents, *topic;
};

struct network_records;

/* `event` is for changes. */
int network_records_open(struct network *network, const struct network_event *event, struct network_records **records);
void network_records_close(struct network_records *records);

/* Publish, or withdraw, a record. -EAGAIN as network_write(): try again later. */
int network_records_write(struct network_records *records, const struct network_record *record);
int network_records_withdraw(struct network_records *records, const struct network_record *record);

/*
 * Call `take` for each change: an item with its record; an item whose record was withdrawn (`gone`; only the key is
 * set); or an item whose machine is away for now (`away`; only the key is set).
 */
enum network_change { NETWORK_THERE, NETWORK_GONE, NETWORK_AWAY };
typedef void network_take_record(void *argument, const struct network_record *record, enum network_change change);
void network_records_read(struct network_records *records, network_take_record *take, void *argument);

/*
 * Records, machines and their readers and writers that were dropped without a record, since the last call: their texts
 * are too long, or there are too many. `machine` and `item` are those of one of them, or 0 and "".
 */
struct network_refused {
    uint64_t count, machine;
    char item[64];
};
void network_records_refused(struct network_records *records, struct network_refused *refused);

/* ---- Clocks: the times of an exchange ---- */

/* Stamps sent by one machine. Times are ns of its CLOCK_MONOTONIC, except `peer_sent`, which is of the peer's. */
struct network_stamps {
    uint64_t machine;
    int64_t sent;
    uint64_t count;                      /* entries in use; from the network any number may come */
    uint64_t peer[NETWORK_MACHINES];     /* machines from which stamps have come */
    int64_t peer_sent[NETWORK_MACHINES]; /* when the newest of these stamps were sent */
    int64_t received[NETWORK_MACHINES];  /* and when they were received */
};

struct network_clock;

/* `event` is for received stamps. */
int network_clock_open(struct network *network, const struct network_event *event, struct network_clock **clock);
void network_clock_close(struct network_clock *clock);

/* Send to all other machines; some messages may be lost. */
int network_clock_write(struct network_clock *clock, const struct network_stamps *stamps);

typedef void network_take_stamps(void *argument, const struct network_stamps *stamps);
void network_clock_read(struct network_clock *clock, network_take_stamps *take, void *argument);

#endif
