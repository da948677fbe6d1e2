/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * libddx: named, typed values in shared memory, on one machine.
 *
 * The `store` program names the items and hands out their memory. One program writes an item, any number of programs
 * read it. The frame path (write, read, acquire, loan) is shared memory and a futex: it never asks the store, and a
 * slow, stopped or dead reader never delays the writer or another reader.
 *
 * The first part is the interface of the DDX papers (E. Duff, "DDXVIDEO: A Lightweight Video Framework for Autonomous
 * Robotic Platforms", section "The store"): same names, same argument order. Return codes, writing, closing and all
 * that follows under "Beyond the paper" are defined here.
 *
 * Common rules
 *   errors     int functions return 0, or -errno; functions that return a pointer return NULL and set errno. The
 *              meanings are the same everywhere, and ddx_error_text() has one clear line for each:
 *                -ECONNREFUSED  no store runs on this machine (at this port)
 *                -ENOENT        the store has no item of this name
 *                -EPROTOTYPE    the item has another type than the caller's, or one that the caller has not declared
 *                -EMSGSIZE      wrong size, or the item's value does not fit the caller's struct
 *                -EEXIST        another living program writes this item
 *                -ENOSPC        the store's memory budget is used up
 *                -EBUSY         no memory left for one reader more, or the item's writer cannot take it (it has no
 *                               descriptor left), or this handle still holds a frame or a loan
 *                -ENOBUFS       every frame of the item is held; nothing was written
 *                -EMFILE        the program has too few descriptors: one for each frame and each reader of each handle
 *                -EDQUOT        the program has more items open than the store keeps for one program: of those that
 *                               it writes some 140 with types of 200 fields, some 400 with small ones
 *                -ETIMEDOUT     nothing was written within the timeout
 *                -EHOSTUNREACH  no other machine of this name is heard
 *                -EFBIG         an item of another machine, whose values are too large to be sent
 *                -EINVAL        a bad argument, or a type that cannot be shared (pointer, union, enum, bit field):
 *                               ddx_type_problem()
 *   time       int64_t nanoseconds of CLOCK_MONOTONIC.
 *   timeout    seconds as a double; 0 does not wait; negative waits without limit.
 *   tail       which write a read waits for, see enum ddx_tail.
 *   threads    a DDX_STORE_ITEM belongs to one thread at a time; different items may be used by different threads.
 *   fork       a child must not use handles of its parent; it opens its own. fork() in the child and exec close what
 *              would let the parent seem alive after its death; vfork() and clone() do not, so exec must follow.
 *   signals    a signal does not end a wait. Programs that stop on TERM read with a timeout.
 */
#ifndef DDX_H
#define DDX_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
/* What these headers declare is what libddx.so exports; all else in the library is hidden. */
#pragma GCC visibility push(default)

typedef struct ddx_store_id DDX_STORE_ID;     /* a connection to a store */
typedef struct ddx_store_item DDX_STORE_ITEM; /* a handle on one item; it reads, or writes, or both */
typedef int64_t DDX_TIME;                     /* ns, CLOCK_MONOTONIC */

#define DDX_STORE_PORT 2005 /* the store's port where none is given (0) */
/*
 * Longest name of an item or a type, in bytes. Names consist of printable ASCII characters, an item's without blanks
 * and '/': the store refuses others, since names are listed and logged as they are.
 */
#define DDX_NAME_MAX 63

/*
 * Define the C type `name` and make its layout known to the store:
 *
 *     DDX_STORE_TYPE(WHEELS, struct { int left; int right; float speed[4]; });
 *
 * At file scope. Integers, floats, char arrays, nested structs and fixed arrays of them; array bounds may be macros and
 * constant expressions. Two programs agree on a type when offset, size and kind of each field are equal; names of
 * fields do not matter. (Variadic, since the declaration may hold commas; expanded before it is turned into text.)
 */
#define DDX_STORE_TYPE(name, ...) DDX_STORE_TYPE_EXPANDED_(name, __VA_ARGS__)
#define DDX_STORE_TYPE_EXPANDED_(name, ...)                                                                      \
    typedef __VA_ARGS__ name;                                                                                    \
    static struct ddx_type_declaration_ ddx_type_declaration_##name##_ = {#name, #__VA_ARGS__, sizeof(name), 0}; \
    __attribute__((constructor)) static void ddx_type_declare_##name##_(void) {                                  \
        ddx_type_declare_(&ddx_type_declaration_##name##_);                                                      \
    }                                                                                                            \
    struct ddx_type_declaration_

struct ddx_type_declaration_ {
    const char *name;
    const char *text;
    size_t size;
    struct ddx_type_declaration_ *next;
};
void ddx_type_declare_(struct ddx_type_declaration_ *declaration);

/*
 * Connect to the store of this machine, where `host` is NULL, or through it to that of another machine, by its name:
 * ddx_store_lookup_item(id, "gps", NULL, 0) is then the item "carol:gps" of this store, for reading. That takes the
 * program `catalog` on both machines; it copies the item as long as the item has a reader here. `port` 0 means
 * DDX_STORE_PORT. Tries for `timeout` seconds, so programs may start before the store. The store's socket lies in
 * $DDX_DIR, or else in /run/ddx, $XDG_RUNTIME_DIR/ddx or /tmp/ddx-<uid>. A store is believed only if root, the caller's
 * user or the folder's owner runs it, and if no other user can have made that folder or can change what is in it.
 * NULL and errno: ECONNREFUSED, there is none; EPERM, there is only one that is not believed; EHOSTUNREACH, no machine
 * `host` is heard; EOPNOTSUPP, no catalog runs here. The result is the
 * caller's, until ddx_store_close().
 */
DDX_STORE_ID *ddx_store_open(const char *host, int port, double timeout);

/*
 * Close the connection and every item still open on it (pointers into frames become invalid). NULL is allowed.
 * Returns 0.
 */
int ddx_store_close(DDX_STORE_ID *id);

/*
 * A handle on the item `name`. With type NULL and size 0 the item must exist, and if this program declared a type of
 * the item's type name (DDX_STORE_TYPE), the declared struct must agree with it. If it declared none, and the type is
 * no plain C type such as "int", the library does not know the caller's struct: the handle shows the item in its own
 * layout (ddx_store_acquire(), ddx_store_read_direct(), ddx_store_loan(), ddx_store_field()), but ddx_store_read() and
 * ddx_store_write(), which copy the caller's struct, fail with -EPROTOTYPE. With a type and its size the item is
 * created when missing. Neither reads nor writes yet: the first write makes the handle the item's writer, the first
 * read takes one reader's share of memory (one frame). Does not wait longer than the store needs to answer (5 s at
 * most). A name "carol:gps" means item gps of the machine carol: the catalog is asked for it, and may take 5 s more,
 * EHOSTUNREACH if it does not hear that machine; an item that it made before is opened all the same. NULL and errno:
 * ENOENT, EPROTOTYPE, EMSGSIZE, ENOSPC, EDQUOT, ECONNREFUSED, EINVAL. The handle is the
 * caller's, until ddx_store_done_item() or ddx_store_close().
 */
DDX_STORE_ITEM *ddx_store_lookup_item(DDX_STORE_ID *id, const char *name, const char *type, int size);

/*
 * A handle for reading the item `name`, also before the item is created: a reader that waits with one (a read waits
 * for the item and its first value) and asks for DDX_IN_ORDER gets everything from the first value on, however soon the
 * writer begins. Until the item is created, its type is "", it has no fields, and no lookup finds it. The number of
 * frames to keep is reduced if the store then has no memory for all of them. Otherwise as ddx_store_lookup_item()
 * with type NULL. Writing with it fails with -ENOENT until then.
 */
DDX_STORE_ITEM *ddx_store_await_item(DDX_STORE_ID *id, const char *name);

/*
 * Give the handle back: its writer's role, its reader's share, its memory mappings. The item and its last value stay in
 * the store. NULL is allowed. Returns 0.
 */
int ddx_store_done_item(DDX_STORE_ITEM *item);

/*
 * Copy a value into *data (the caller's struct, in the layout that the caller declared) and its time of writing into
 * *ts (NULL allowed). The copy is never torn. Only into a struct that the library knows: this program has declared the
 * item's type, or gave type and size to ddx_store_lookup_item(), else -EPROTOTYPE and nothing is taken. The library
 * cannot see which of its structs the caller passes: compare ddx_store_item_type() where the name comes from outside.
 * Errors: -ETIMEDOUT, -EMSGSIZE, -EPROTOTYPE, -EINVAL; of the first read, which asks the store for a place among the
 * readers and waits for its answer, 5 s at most, also -EBUSY, -EMFILE, -ECONNREFUSED. On failure *data and *ts are as
 * before.
 */
int ddx_store_read(DDX_STORE_ITEM *item, void *data, DDX_TIME *ts, double timeout, int tail);

/*
 * The address at which ddx_store_read_direct() shows the item, the same for the life of the handle; read-only memory.
 * Zeros before the first ddx_store_read_direct(). NULL and errno ENOMEM or EPROTOTYPE on failure.
 */
void *ddx_store_var_pointer(DDX_STORE_ITEM *item);

/*
 * As ddx_store_read(), without copying: the value appears at ddx_store_var_pointer() and cannot change before the next
 * ddx_store_read_direct() or ddx_store_done_item() of this handle. On failure the value shown is the former one. While
 * a call waits, other threads find anything there.
 */
int ddx_store_read_direct(DDX_STORE_ITEM *item, DDX_TIME *ts, double timeout, int tail);

/* ---- Beyond the paper ---- */

/*
 * Which write a read waits for. "Seen" means: delivered to this handle, or written before its first read. Numbers above
 * 1: the n-th next write.
 */
enum ddx_tail {
    DDX_CURRENT = 0,  /* the newest value, now; waits only when nothing was ever written */
    DDX_NEXT = 1,     /* the newest value not yet seen; waits for the next write if there is none */
    DDX_IN_ORDER = -1 /* the oldest kept value not yet seen: for readers that need every frame (a recorder) */
};

/*
 * Write a value: copies *data (layout as declared by the caller, or as created) into the store and wakes the readers.
 * If that layout is not known, as for ddx_store_read(), it fails with -EPROTOTYPE without becoming the writer.
 * `ts` is the time of the write, NULL for now. Never waits for a reader. The first call makes the handle the writer,
 * and waits for the store to answer, 5 s at most. Errors: -EEXIST, -ENOSPC, -EPROTOTYPE, -EMFILE, -ENOBUFS,
 * -ECONNREFUSED, -EINVAL, -ENOENT (see ddx_store_await_item()). What is given up is counted: ddx_store_short().
 */
int ddx_store_write(DDX_STORE_ITEM *item, const void *data, const DDX_TIME *ts);

/* One field's share of use, for items that use less than their struct declares (a small picture in a large array). */
struct ddx_extent {
    const char *field; /* name in the declaration, for example "y"; a field of the outermost struct */
    size_t bytes;      /* bytes used, from the start of the field; 0: none, as long as some other field is used */
};

/* What ddx_store_create() makes. */
struct ddx_item_spec {
    const char *name;        /* of the item */
    const char *type;        /* of the type: 1 to DDX_NAME_MAX bytes */
    const char *declaration; /* C text such as "struct { int a; char b[64]; }"; NULL: the DDX_STORE_TYPE of `type` */
    size_t size;             /* sizeof the struct; checked against the declaration; 0: not checked */
    const struct ddx_extent *extents; /* fields that are used in part; memory is taken for the used part only */
    unsigned extent_count;
};

/*
 * Create the item, or take it over from a writer that is gone, and become its writer at once. The last whole value
 * stays readable when the layout stays the same; sequence numbers go on. Fields that have an extent may get another
 * bound or extent than before (a camera that changes its format); everything else must equal the item's former type,
 * unless no program uses the item. On success *item is the caller's. Errors: -EEXIST, -ENOSPC, -EPROTOTYPE, -EMSGSIZE,
 * -EINVAL, -EMFILE, -EDQUOT, -ENOMEM, -ECONNREFUSED.
 */
int ddx_store_create(DDX_STORE_ID *id, const struct ddx_item_spec *spec, DDX_STORE_ITEM **item);

/* A value held by a reader. */
struct ddx_frame {
    const void *data;  /* the item's struct, in its own layout (ddx_store_field); beyond a field's extent is nothing */
    DDX_TIME time;     /* of the write */
    uint64_t sequence; /* number of the write, from 1, without gaps, across writers */
    uint64_t missed;   /* writes between the one seen before and this one, not delivered to this handle */
};

/*
 * Hold a value without copying it: it cannot change until ddx_store_release(). One at a time per handle (-EBUSY); a
 * second handle on the same item holds a second one. Errors as ddx_store_read(), except that the layout is the item's
 * own. On failure *frame is untouched.
 */
int ddx_store_acquire(DDX_STORE_ITEM *item, struct ddx_frame *frame, double timeout, int tail);

/* Let go of the value that ddx_store_acquire() gave; frame->data is invalid afterwards. 0, -EINVAL if none is held. */
int ddx_store_release(DDX_STORE_ITEM *item);

/*
 * Keep `frames` frames for this handle instead of one, so that DDX_IN_ORDER finds older ones when the reader comes
 * late. Each costs one frame of memory. Before the first read any number, which that read asks the store for: it fails
 * with -EBUSY where the budget has no room, and a smaller number may be tried. Later more only; waits for the store to
 * answer, at most 5 s. Errors: -EBUSY (no room, nothing has changed), -EINVAL, -ECONNREFUSED.
 */
int ddx_store_keep(DDX_STORE_ITEM *item, unsigned frames);

/* Number of frames kept for this handle; fewer than requested only if the handle awaited the item. 0 for NULL. */
unsigned ddx_store_kept(const DDX_STORE_ITEM *item);

/*
 * A free frame to write in place, in the item's own layout: *data. Its content is undefined (an older frame). Then
 * either ddx_store_publish() or ddx_store_cancel(). Waits and fails as ddx_store_write(); -EBUSY: already loaned.
 */
int ddx_store_loan(DDX_STORE_ITEM *item, void **data);

/*
 * Publish the loaned frame and wake the readers; `ts` as in ddx_store_write(). -EINVAL if nothing is loaned; -EEXIST:
 * the frame is given back, since another writer took over.
 */
int ddx_store_publish(DDX_STORE_ITEM *item, const DDX_TIME *ts);

/*
 * Writes of this handle that succeeded and yet came to nothing: another writer had taken over while this program was
 * stopped and the store restarted, and it had not heard of that. Complete when a write has failed with -EEXIST.
 */
uint64_t ddx_store_lost(const DDX_STORE_ITEM *item);

/* Number of the item's newest write, for the handle that writes it: its own, or its forerunners'. Else 0. */
uint64_t ddx_store_written(const DDX_STORE_ITEM *item);

/*
 * Writes and loans of this handle that were given up: -ENOBUFS, every frame is held (the store makes room for what each
 * of its readers holds, but after a restart it may not know all of them yet); or -EMFILE, a reader has come that the
 * program has no descriptor for, until the store has refused it.
 */
uint64_t ddx_store_short(const DDX_STORE_ITEM *item);

/* Give the loaned frame back unpublished. Returns 0, -EINVAL if nothing is loaned. */
int ddx_store_cancel(DDX_STORE_ITEM *item);

/* Facts about an item. */
struct ddx_item_info {
    char name[DDX_NAME_MAX + 1];
    char type[DDX_NAME_MAX + 1];
    uint64_t size;        /* bytes of the struct */
    uint64_t frame_bytes; /* memory of one frame (whole pages) */
    uint64_t bytes;       /* memory of the item now: all frames and the control pages */
    uint64_t reserved;    /* of the budget: the above and what a change of writer needs */
    uint64_t sequence;    /* number of the last write, 0 if none */
    DDX_TIME time;        /* of the last write */
    uint32_t frames;      /* frames that exist */
    uint32_t readers;
    uint32_t epoch;      /* changes of writer so far, from 1; 0 if never written */
    int32_t writer_pid;  /* 0 if the item has no writer now */
    uint64_t missed_max; /* frames missed by the reader that missed most */
};

/* Facts about this handle's item. Waits for the store to answer, at most 5 s. 0, -ECONNREFUSED. */
int ddx_store_item_info(DDX_STORE_ITEM *item, struct ddx_item_info *info);

/*
 * How many readers the item of this writing handle has now. A reader counts as soon as the memory is there for what it
 * keeps: it gets each value written from then on, unless more of them come than it keeps. Does not wait. -EINVAL if the
 * handle does not write.
 */
int ddx_store_readers(const DDX_STORE_ITEM *item);

/*
 * For a writer that has time, because it copies what lies somewhere: whether the next write or loan would cost a reader
 * a value that it has not seen. It may look again later, but not for ever: a reader may be stopped, or look only now
 * and then. Does not wait. 1, 0; -EINVAL if the handle does not write; -EBUSY: loaned already.
 */
int ddx_store_outruns(const DDX_STORE_ITEM *item);

/* Facts about the store as a whole. */
struct ddx_store_info {
    uint64_t budget;   /* bytes, as given by -m */
    uint64_t bytes;    /* memory in use */
    uint64_t reserved; /* of the budget, never above it */
    uint32_t items, clients;
    int32_t pid;
    uint32_t restarts; /* of its worker, which died or hung and was replaced; no program loses anything by that */
};

/*
 * All items, sorted by name, in an array that the caller frees with free(); *count of them. `store` may be NULL.
 * Waits for the store to answer, at most 5 s. 0, -ECONNREFUSED, -ENOMEM.
 */
int ddx_store_list(DDX_STORE_ID *id, struct ddx_store_info *store, struct ddx_item_info **items, unsigned *count);

/* Kinds of field. */
enum ddx_kind { DDX_KIND_INT = 1, DDX_KIND_UNSIGNED, DDX_KIND_FLOAT, DDX_KIND_CHAR, DDX_KIND_STRUCT };

/* One field of an item's type, in the item's own layout. */
struct ddx_field {
    const char
        *name; /* "y"; for nested ones the full path: "pose.x"; arrays of structs are listed once: "wheel.speed" */
    enum ddx_kind kind;
    uint32_t bytes;    /* of one element */
    uint32_t count;    /* elements (array bound), 1 for a single one */
    uint64_t offset;   /* from the start of the item; inside an array of structs: of its first element */
    uint64_t used;     /* bytes in use, from the start of the field: bytes * count unless an extent says less */
    uint32_t children; /* DDX_KIND_STRUCT: how many of the following fields lie inside */
    uint32_t extent;   /* 1: its writers say how much is in use; the array bound is no part of the type */
};

/*
 * The i-th field of the item's type, from 0, or NULL past the last. A field named "" is an item that is no struct.
 * Valid until the next call that reads, acquires or loans this item (a new writer may change it).
 */
const struct ddx_field *ddx_store_field(const DDX_STORE_ITEM *item, unsigned index);

/* The field of this full name, or NULL. As ddx_store_field(). */
const struct ddx_field *ddx_store_field_named(const DDX_STORE_ITEM *item, const char *name);

/*
 * Grows whenever the fields returned by ddx_store_field() for this item may have changed: a program that keeps data
 * derived from the fields compares this number.
 */
uint32_t ddx_store_layout(const DDX_STORE_ITEM *item);

/* The item's name; its type's name. Valid as long as the handle. */
const char *ddx_store_item_name(const DDX_STORE_ITEM *item);
const char *ddx_store_item_type(const DDX_STORE_ITEM *item);

/*
 * Number of the newest write that this handle has seen; after a first read that timed out: of the newest that was there
 * when the handle began to read, so that all later ones are delivered or counted as missed. 0: none.
 */
uint64_t ddx_store_seen(const DDX_STORE_ITEM *item);

/* Writes that passed this handle by since it began to read. */
uint64_t ddx_store_missed(const DDX_STORE_ITEM *item);

/* Now, as the store counts time. */
DDX_TIME ddx_time_now(void);

/* One clear line for a -errno of this library (or the negated errno), without a full stop. Never NULL. */
const char *ddx_error_text(int error);

/*
 * What is wrong with a type, as one line in text[bytes] (200 are enough for it) that names the word at fault. `type` is
 * the name of a type that this program has declared (DDX_STORE_TYPE), or a declaration as in struct ddx_item_spec.
 * 0: nothing, it can be shared, and the text is empty; -EINVAL; -ENOMEM. Does not wait.
 */
int ddx_type_problem(const char *type, char *text, size_t bytes);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
