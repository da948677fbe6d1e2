/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The state that a trial judges: of the machine now, and before the restart. */
#ifndef DDXUPDATE_SIGHT_H
#define DDXUPDATE_SIGHT_H

#include <stdint.h>

#include "place.h"

enum { SERVICES_MAX = 48 };

/* The services, as a trial sees them. */
struct service {
    char name[WORD_MAX];
    bool enabled;       /* in its settings, when the list was written */
    bool runs;          /* or has done its work, if that is what it is for */
    bool misconfigured; /* it refused its settings */
    bool stopped;       /* by a person, since then */
    bool full;          /* a recorder or logger whose disk has no room: as in the version before */
    unsigned restarts;  /* unwanted ones since the boot */
};

struct services {
    struct service list[SERVICES_MAX];
    unsigned count;
};

/* Read the list in /run/update.services, the lines of `control states`. */
void services_read(const struct place *place, struct services *services);

enum { COUNTERS_MAX = 16 };

/* The frames of grabbers, recorders and loggers, by the counters that each program keeps in the store. */
struct counter {
    char name[WORD_MAX]; /* of the instance */
    enum { GRABBER, RECORDER, LOGGER } kind;
    uint64_t taken;   /* frames in */
    uint64_t passed;  /* a grabber's frames in, a recorder's or logger's frames out */
    uint64_t waiting; /* not on the disk yet */
    uint64_t lost;    /* for any reason */
};

struct frames {
    bool answered; /* the store has, within five seconds */
    struct counter list[COUNTERS_MAX];
    unsigned count;
};

void frames_look(struct frames *frames);

/* The counters of an instance; NULL: there are none. */
const struct counter *frames_find(const struct frames *frames, const char *name);

enum { LINKS_MAX = 16, LINK_NAME = 16, SSH_PORT = 22 };

/* Network interfaces, and whether the machine can be reached. */
struct link {
    char name[LINK_NAME];
    bool carrier; /* a cable, or a wireless network */
    bool address; /* IPv4, or IPv6 that is valid beyond the link */
};

struct network {
    struct link list[LINKS_MAX];
    unsigned count;
};

/* NULL if there is none of that name. */
const struct link *network_find(const struct network *network, const char *name);

/* Whether a server on this machine's port answers as SSH does. Waits at most five seconds. */
bool ssh_answers(unsigned port);

enum { WORDS_MAX = 2048 };

struct sight {
    struct services services;
    struct frames frames;
    struct network network;
    bool ssh;      /* port 22 answers */
    bool watchdog; /* it would reset the machine */
    bool checking; /* the recordings' disk is being checked, so recorders wait */
};

/* Look at all but `services.list`, which is only brought up to date, and `ssh`. */
void sight_look(const struct place *place, struct sight *sight);

/* The state before the restart, as noted in /data/update. */
struct former {
    bool known;
    char runs[WORDS_MAX], flows[WORDS_MAX], links[WORDS_MAX], addresses[WORDS_MAX]; /* names with blanks in between */
    bool ssh, watchdog;
};

/* From two looks at the machine, one after the other. */
void former_make(struct former *former, const struct sight *before, const struct sight *now);

/* That of the last `start`, if it was for this slot and version. */
void former_read(struct former *former, const struct place *place, const char *version);

/* Whether the list has the name. */
bool former_has(const char *words, const char *name);

#endif
