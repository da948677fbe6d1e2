/* SPDX-License-Identifier: GPL-2.0-or-later */
/* This machine and the other ones in the network: ids, names, clocks. */
#ifndef DDXCATALOG_MACHINES_H
#define DDXCATALOG_MACHINES_H

#include <name.h>
#include <network.h>
#include <stdbool.h>
#include <stdint.h>

/* ---- This machine ---- */

struct identity {
    uint64_t id; /* changes with each boot */
    char boot[40];
    char host[NAME_MACHINE]; /* the machine's own name */
    char name[NAME_MACHINE]; /* its name for others: the same, or carol-<4 hex> */
    int64_t since;           /* start of this program, ns of wall time */
};

/* Set all but `identity->host`, which the caller has set. `port` distinguishes stores of one machine. */
void identity_begin(struct identity *identity, long port);

/* Take the name carol-<4 hex>; take the own name again. */
void identity_yield(struct identity *identity);
void identity_return(struct identity *identity);

/*
 * ---- Clocks ----
 *
 * The difference between another machine's clock and this machine's, from four time stamps, as in NTP. Of the newest
 * exchanges the one with the least bound counts: half of the round trip, plus the possible drift of the clocks since.
 */

#define OFFSET_SAMPLES 8

/* Times are ns of CLOCK_MONOTONIC of either machine. */
struct offset_sample {
    int64_t offset, bound, at;
};

/* All 0: no exchange yet. */
struct offset {
    struct offset_sample sample[OFFSET_SAMPLES];
    unsigned count;
};

/*
 * Add an exchange: `sent` here, `received` there; `answered` there, and the answer arrived here at `now`. False: these
 * stamps are impossible.
 */
bool offset_add(struct offset *offset, int64_t sent, int64_t received, int64_t answered, int64_t now);

/* The other clock minus this clock, and the bound of the error. False: not known. */
bool offset_get(const struct offset *offset, int64_t now, int64_t *apart, int64_t *bound);

/* ---- The other machines, in the order in which they were first heard, and their names here ---- */

struct machine {
    uint64_t id;
    char called[NAME_MACHINE]; /* the name that it announces */
    char host[NAME_MACHINE];   /* its host name */
    int64_t since;             /* start of its catalog, ns of its wall time */
    char name[NAME_MACHINE];   /* its name here; differs if another machine announces the same name */
    bool away;                 /* it is not heard */
    unsigned items;            /* number of its known items, and */
    size_t bytes;              /* their memory; maintained by the directory */
    /* Maintained by the clock: its newest time stamps, and the offset of its clock from this one's. */
    int64_t stamp_sent, stamp_received;
    struct offset offset;
    unsigned asked;
};

struct machines {
    struct machine list[NETWORK_MACHINES];
    unsigned count;
};

/* Add or update the machine of a record; NULL: invalid names, or no room. */
struct machine *machines_take(struct machines *machines, const struct identity *own,
                              const struct network_record *record);

/* To be called after a change of this machine's name. */
void machines_renamed(struct machines *machines, const struct identity *own);

/* NULL: not known. Valid until a machine is added or dropped. */
struct machine *machines_find(struct machines *machines, uint64_t id);

/* The heard machine with this name here (`length` bytes of `name`); NULL if there is none. */
const struct machine *machines_named(const struct machines *machines, const char *name, size_t length);

/* The machine is not heard any more. */
void machines_away(struct machines *machines, const struct identity *own, uint64_t id);

/* Remove the machine. */
void machines_drop(struct machines *machines, const struct identity *own, uint64_t id);

/*
 * A machine that is away and can be dropped: a heard machine announces the same name (it was restarted), or the list is
 * full. NULL if there is none.
 */
const struct machine *machines_superseded(const struct machines *machines);

/*
 * Whether a heard machine had this machine's own name before. `proven`: only a machine that takes part in the exchange
 * of clocks, as each catalog does; a record alone can be forged without receiving anything.
 */
bool machines_take_name(const struct machines *machines, const struct identity *own, bool proven);

/* Number of other machines with this machine's host name. */
unsigned machines_of_host(const struct machines *machines, const struct identity *own);

#endif
