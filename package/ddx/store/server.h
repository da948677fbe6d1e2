/* SPDX-License-Identifier: GPL-2.0-or-later */
/* The store: who has which item, and how much memory that takes. One thread, nothing here is on the frame path. */
#ifndef STORE_SERVER_H
#define STORE_SERVER_H

#include "../lib/fault.h"
#include "../lib/futex.h"
#include "../lib/memory.h"
#include "../lib/queue.h"
#include "../lib/ring.h"
#include "kept.h"

/* The memory files of one writer's term. */
struct epoch {
    uint32_t number;
    struct ddx_layout *layout;
    uint64_t digest; /* of its bytes */
    struct ddx_runs runs;
    int control_fd;
    int readers_fd; /* the same file as readers get it: as long as one has it, the kernel tells; -1: none got it yet */
    struct ddx_control *control;
    bool control_ready; /* the writer has mapped and sealed it: readers may have it */
    unsigned slots;
    int slot_fd[DDX_SLOTS_MAX];     /* -1: does not exist */
    bool slot_told[DDX_SLOTS_MAX];  /* the writer knows of it */
    bool slot_ready[DDX_SLOTS_MAX]; /* and has mapped and sealed it */
};

struct client {
    struct client *next;
    int socket;
    uint64_t handled;       /* number of its last request that was handled */
    struct ddx_queue queue; /* what is to be sent when all is committed, and it has read more */
    int32_t pid;
    bool gone;
    bool early; /* asks for something that it may not have yet: see client.c */
    struct item *item;
    /* as a reader: */
    uint32_t id; /* 0: does not read */
    unsigned keep;
    bool admitted;  /* the writer looks at its pins, or will before it writes: it may hear of frames, and pin them */
    bool unseen;    /* the writer cannot, and is told again and again */
    int64_t told_at; /* the last time */
    uint32_t version; /* of the notice, when the writer was told */
    unsigned asked; /* frames of its ATTACH that is not answered yet, 0: there is none */
    int64_t asked_at;
    uint64_t asked_after; /* the newest frame at that time */
    bool counted; /* by the writer: frames are kept for it */
    int pin_fd;
    const struct ddx_pin_page *pin;
    /* what it offers after our restart, until OFFER_END */
    struct epoch *offered;
    int offered_notice_fd, offered_pin_fd;
    unsigned offered_keep;
    uint32_t offered_seen; /* the notice's version up to which it has heard of readers */
    /* in the middle of LIST: the last item it was told of */
    bool listing;
    char listed[DDX_NAME_MAX + 1];
};

#define ENDED 8 /* terms whose end is remembered */

struct ended {
    uint32_t epoch;    /* 0: none */
    uint64_t sequence; /* of its last frame, as its successor carried it over */
};

struct item {
    struct item *next; /* sorted by name */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
    struct ddx_layout *layout; /* as wanted by whoever asked first, then as written */
    struct epoch *epoch;       /* readers see this one */
    struct epoch *pending;     /* a new writer prepares this one */
    struct client *writer;
    bool foreign; /* its epoch came from an offer: there may be a newer one */
    bool adopted; /* known from an offer after a restart; its writer may live without having reported */
    bool away;    /* its writer hung up; if it lives, it comes back */
    uint32_t epochs, handles, readers, kept;
    uint32_t numbered; /* the last epoch that files were made for; it may not have begun */
    int notice_fd;
    struct ddx_notice *notice;
    uint32_t announced; /* the notice's version when the writer has heard of all readers */
    uint32_t taken;     /* and of those whose pins it looks at, or has refused to */
    uint32_t counted;   /* what the notice says of readers when everybody has heard everything */
    uint64_t sequence; /* of the last epoch's last frame */
    struct ended ended[ENDED];
};

/* A descriptor: see files.h. */
struct file {
    uint16_t users; /* messages */
    bool closed;    /* but for them */
};

/* What a worker knows, and leaves to the next one: all of it is kept memory. */
struct store {
    struct item *items;
    struct client *clients;
    struct client *current; /* whose request is being handled */
    struct retired *retired;
    struct file *file; /* by descriptor */
    unsigned file_count;
    uint32_t next_reader;
    int64_t listened; /* ns that this store had an ear for others, without what it was stopped for */
    bool open;        /* living holders have had time to report, if they are awake: newcomers may come in */
    bool settled;     /* who has not yet, is stopped or dead */
};
extern struct store *store;

/* What is so from the beginning, for all workers. */
struct settings {
    int port;
    int listener;
    uint64_t budget;
    bool restarted; /* a store ran here before: living holders will report */
};
extern struct settings settings;

/* note.c: a line for people; say() is for a whole text. False: nobody reads, it was left out. */
void note(const char *format, ...) __attribute__((format(printf, 1, 2)));
bool say(int fd, const char *text, size_t length);

/* worker.c */
int worker_run(void);

/* succession.c */
void store_memory(void);    /* queues keep their messages where they outlive the worker */
void store_take_over(void); /* from the worker before */
void store_commit(void);    /* what was done is done */
/* Now that it is committed, what is to be said: to this client (or NULL) after all others. */
void store_say(struct client *last);

/* items.c */
struct item *item_find(const char *name);
struct item *item_add(const char *name, const char *type, const struct ddx_layout *layout); /* NULL: no memory */

/* Whether readers wait for an item that nobody has created yet: it has no type and no layout. */
bool item_is_awaited(const struct item *item);

/* Somebody creates it. 0 or -ENOMEM. */
int item_define(struct item *item, const char *type, const struct ddx_layout *layout);
void item_drop_if_unused(struct item *item);
int item_set_notice(struct item *item, int fd); /* takes fd, also on failure */
uint64_t item_bytes(const struct item *item); /* of what is to be had of it: no epoch that has ended */
uint64_t item_reserved(const struct item *item);
void item_describe(const struct item *item, struct ddx_message *message);
void item_send_epoch(const struct item *item, struct client *reader);
void item_send_slot(const struct item *item, const struct epoch *epoch, unsigned slot, struct client *to,
                    uint32_t flags);
void item_send_new_slots(const struct item *item, struct epoch *epoch, struct client *writer);
/* To the writer, who answers with TAKEN: see reader_taken(). */
void item_announce(struct item *item, struct client *reader);

/* epoch.c */
struct ddx_layout *store_layout(const struct ddx_layout *layout); /* a copy that is kept; NULL: no memory */
struct epoch *epoch_new(const struct ddx_layout *layout, uint32_t number);
int epoch_create_control(struct epoch *epoch, const char *name);
int epoch_add_slots(struct epoch *epoch, const char *name, unsigned count);
bool epoch_ready(const struct epoch *epoch);
/* True if a frame was carried over; *sequence is the number with which `from` ends, if it has any. */
bool epoch_carry_over(struct epoch *from, struct epoch *to, uint64_t *sequence);
void epoch_free(struct epoch *epoch);

/* An epoch that has ended, see below. */
struct retired {
    struct retired *next;
    const struct item *item; /* NULL: it is no more */
    uint64_t bytes;
    int watch; /* a description of the control page that nobody else has */
};

/*
 * retired.c: epochs that have ended. Whoever still has one, because it is stopped or has not read that the next one has
 * begun, keeps its memory, so it counts until the kernel says that nobody has it any more.
 */
void epoch_retire(struct item *item, struct epoch *epoch); /* takes it; NULL is none */
uint64_t retired_bytes(const struct item *item);           /* NULL: of items that are no more */
void retired_sweep(void);
void retired_forget(const struct item *item); /* it is no more */

/* label.c: the names of memory files. Each is good until the next one is asked for. */
#define LABEL_MAX 128
uint64_t label_digest(const struct ddx_layout *layout);
const char *label_of(const char *item, const char *what); /* "pin" or "notice" */
const char *label_of_slot(const char *item, const struct epoch *epoch, unsigned slot); /* DDX_NO_SLOT: control */
bool label_is(int fd, const char *label); /* and a store of this user made it */

/* budget.c */
uint64_t budget_used(void);
uint64_t budget_reserved(void);
/* May this item's reservation become `reserved`? Makes room by dropping items that nobody holds, oldest first. */
bool budget_allows(struct item *item, uint64_t reserved);

/* request.c: one message of a client. */
void request_handle(struct client *client, struct ddx_packet *packet);
void list_continue(struct client *client);

/* claim.c: terms of writing. */
void writer_claim(struct client *client, const struct ddx_layout *layout);
void writer_ready(struct client *client, const struct ddx_message *message);
void writer_taken(struct client *client, const struct ddx_message *message);
void writer_left(struct client *client);

/* readers.c */
void reader_attach(struct client *client, unsigned keep);
/* Its writer looks at its pins, or (-errno) does not; it is told so if it has asked. */
void reader_taken(struct client *client, int status);
/*
 * Whether any of them waits for that. A writer that is stopped keeps nobody waiting for long: when the news is in its
 * socket, and the notice says so, it takes it in before it writes.
 */
bool readers_wait(void);
/* There is no writer any more: who waits for it is let in, unless it lives and may come back. */
void readers_without_writer(struct item *item);
/* Whether it reads this item; and may hear of its frames. */
bool reader_of(const struct client *client, const struct item *item);
bool reader_hears(const struct client *client, const struct item *item);
/* Give the writer as many slots as there are pins, plus the newest and the one being written. 0 or -EBUSY. */
int reader_add_slots(struct item *item, unsigned keep, unsigned pages);
int reader_register(struct client *client, int pin_fd, unsigned keep);
void reader_left(struct client *client);
void readers_announce(struct item *item);          /* all of them, to its writer */
void readers_send_epoch(const struct item *item); /* to all that may hear of it */
/* Count the readers for whom frames are kept: once the writer has their slots, and they know them. */
void readers_count(struct item *item);
void readers_tell(void); /* to all writers, when everybody has been told of the rest */

/* adopt.c */
void offer_message(struct client *client, struct ddx_packet *packet);
void offer_abandon(struct client *client);

/* client.c */
struct client *client_add(int socket);
void client_receive(struct client *client);
void client_send(struct client *client, const struct ddx_message *message, const struct ddx_layout *layout,
                 const int *fds, unsigned count); /* after the commit, and when there is room */
/* Send to all what they have room for; to this one (or NULL) last. Whether there was anything. */
bool clients_go_on(struct client *last);
/*
 * What is kept for its process, besides connections and items: offers that are not complete, and messages that it has
 * not read. A quarter of our descriptors, but a whole item in any case.
 */
bool client_holds_too_much(const struct client *client);
void client_reply(struct client *client, uint32_t operation, int status);
/*
 * Take back what those hold who hung up but whose last messages were not read yet: who asks for a thing after another
 * gave it back must get it. To be called before anything is refused.
 */
void clients_reap(void);
void clients_sweep(void); /* forget those who are gone */

#endif
