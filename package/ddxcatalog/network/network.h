/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Publishing and subscribing by DDS. Only the files of this folder know which implementation of it that is.
 *
 * All functions return 0 or -errno, none waits for the network. A writer may be used by one thread, everything else by
 * the thread that opened the network.
 */
#ifndef DDXCATALOG_NETWORK_H
#define DDXCATALOG_NETWORK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "description.h"

#define NETWORK_PEERS 16
#define NETWORK_MACHINES 32 /* other ones that are known at a time */

struct network_options {
    unsigned domain;
    const char *interface;            /* NULL: chosen automatically, not the loopback interface */
    const char *peers[NETWORK_PEERS]; /* addresses that are asked one by one, ended by NULL */
    bool unicast;                     /* no multicast at all */
};

struct network;
struct network_writer;
struct network_reader;

/* Something to wait for. `ready` is called by network_wait(). */
struct network_event {
    void (*ready)(void *argument);
    void *argument;
};

/* -EINVAL: a name that cannot be an interface or an address; -EADDRNOTAVAIL: no such interface, or no network. */
int network_open(const struct network_options *options, struct network **network);

/*
 * Whether this machine has lost an address that it had when the network was opened. It is to be opened again then.
 */
bool network_moved(const struct network *network);

/*
 * All writers that are closed from now on wait one second, counted from now, for their readers to confirm what they
 * were sent; without this call, they do not wait.
 */
void network_linger(struct network *network);

/* Readers and writers are closed before. NULL is allowed. */
void network_close(struct network *network);

/* Wait for an event, `seconds` at most, and let the owners of the events act. */
void network_wait(struct network *network, double seconds);

/* ---- Values: messages in CDR ---- */

/*
 * A writer for messages of up to `size` bytes; `event`, which must outlive the writer, when a reader has come or gone.
 * `latched`: also for readers that ask for the values before them; the newest is kept for these.
 * -EINVAL: a type that cannot be described; -ENOMEM.
 */
int network_writer_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        bool latched, const struct network_event *event, struct network_writer **writer);
void network_writer_close(struct network_writer *writer);

/* How many readers there are, and in *came how many have come since the last call. */
unsigned network_writer_readers(struct network_writer *writer, unsigned *came);

/*
 * Send a message. `wall`: its time, ns of wall time. There is room for four bytes after message[size], which are
 * written to. -EAGAIN: readers have not confirmed what they were sent before, and it would have to wait; -EINVAL.
 */
int network_write(struct network_writer *writer, unsigned char *message, size_t size, int64_t wall);

/* A reader for such messages; `event`, when there is one. */
int network_reader_open(struct network *network, const char *topic, const struct description *description, size_t size,
                        const struct network_event *event, struct network_reader **reader);
void network_reader_close(struct network_reader *reader);

/* Calls `take` for each message that has come, in order. `writer` identifies the writer that sent it. */
typedef void network_take(void *argument, uint64_t writer, const unsigned char *message, size_t size);
void network_read(struct network_reader *reader, network_take *take, void *argument);

/* ---- What there is: kept for those who come later ---- */

/* An item of a machine, or the machine itself, whose item is "". From the network anything may be in it. */
struct network_record {
    uint64_t machine; /* with `item`, the key */
    char *item;
    char *name;    /* of the machine */
    int64_t since; /* when the machine's catalog was started, ns of its wall time; never after padding */
    char *host;    /* its host name, another one where two machines have the same */
    char *boot; /* boot id, which identifies the boot that CLOCK_MONOTONIC belongs to */
    char *type, *declaration, *extents, *topic;
};

struct network_records;

/* `event`: when something has changed. */
int network_records_open(struct network *network, const struct network_event *event, struct network_records **records);
void network_records_close(struct network_records *records);

/* Say, or say no more, that there is such an item. -EAGAIN as network_write(): to be tried again. */
int network_records_write(struct network_records *records, const struct network_record *record);
int network_records_withdraw(struct network_records *records, const struct network_record *record);

/*
 * Calls `take` for each change: an item with its record; an item whose record was withdrawn (`gone`; only the
 * key is set); or an item whose machine is away for now (`away`; only the key, too).
 */
enum network_change { NETWORK_THERE, NETWORK_GONE, NETWORK_AWAY };
typedef void network_take_record(void *argument, const struct network_record *record, enum network_change change);
void network_records_read(struct network_records *records, network_take_record *take, void *argument);

/* ---- Clocks: the times of an exchange ---- */

/* Of one machine. Times are ns of CLOCK_MONOTONIC: of this machine, but those of `peer_sent`. */
struct network_stamps {
    uint64_t machine;
    int64_t sent;
    uint64_t count; /* of what follows; from the network any number may come */
    uint64_t peer[NETWORK_MACHINES];     /* the newest stamps that have come from these machines, */
    int64_t peer_sent[NETWORK_MACHINES]; /* when they were sent */
    int64_t received[NETWORK_MACHINES];  /* and when they were received */
};

struct network_clock;

/* `event`: when stamps have come. */
int network_clock_open(struct network *network, const struct network_event *event, struct network_clock **clock);
void network_clock_close(struct network_clock *clock);

/* To all other machines; some may be lost. */
int network_clock_write(struct network_clock *clock, const struct network_stamps *stamps);

typedef void network_take_stamps(void *argument, const struct network_stamps *stamps);
void network_clock_read(struct network_clock *clock, network_take_stamps *take, void *argument);

#endif
