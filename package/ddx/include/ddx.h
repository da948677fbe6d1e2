/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * libddx: named, typed values in shared memory, on one machine.
 *
 * The `store` program names the items and hands out their memory. One program writes an item, any number of programs
 * read it. The frame path (write, read, acquire, loan) is shared memory and a futex: it never asks the store, and a
 * slow, stopped or dead reader never delays the writer or another reader.
 *
 * The first part is the interface of the DDX papers (E. Duff, "DDXVIDEO: A Lightweight Video Framework for Autonomous
 * Robotic Platforms", section "The store"): same names, same argument order. The paper does not define return codes,
 * writing, closing, and the functions under "Beyond the paper"; they are defined here.
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
 *                -EBUSY         no memory left for another reader, or the item's writer has no descriptor left for
 *                               the reader, or this handle still holds a frame or a loan
 *                -ENOBUFS       every frame of the item is held; nothing was written
 *                -EMFILE        the program has too few descriptors: one for each frame and each reader of each handle
 *                -EDQUOT        the program has more items open than the store allows one program: about 140 written
 *                               items with types of 200 fields, about 400 with small types
 *                -ETIMEDOUT     nothing was written within the timeout
 *                -EHOSTUNREACH  the catalog has not heard from a machine of this name
 *                -EFBIG         an item of another machine, whose values are too large to be sent
 *                -EINVAL        a bad argument, or a type that cannot be shared (pointer, union, enum, bit field):
 *                               ddx_type_problem()
 *   time       int64_t nanoseconds of CLOCK_MONOTONIC.
 *   timeout    seconds as a double; 0 does not wait; negative waits without limit.
 *   tail       which write a read waits for, see enum ddx_tail.
 *   threads    a DDX_STORE_ITEM belongs to one thread at a time; different items may be used by different threads.
 *   fork       a child must not use its parent's handles; it opens its own. fork() and exec close, in the child, the
 *              descriptors that would make a dead parent seem alive; after vfork() or clone() exec must follow.
 *   signals    a signal does not interrupt a wait. Programs that stop on TERM read with a timeout.
 */
#ifndef DDX_H
#define DDX_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif
/* libddx.so exports the declarations of these headers; all other symbols are hidden. */
#pragma GCC visibility push(default)

typedef struct ddx_store_id DDX_STORE_ID;     /* a connection to a store */
typedef struct ddx_store_item DDX_STORE_ITEM; /* a handle on one item; it reads, or writes, or both */
typedef int64_t DDX_TIME;                     /* ns, CLOCK_MONOTONIC */

#define DDX_STORE_PORT 2005 /* the store's default port, used for port 0 */
/*
 * Longest name of an item or a type, in bytes. Names consist of printable ASCII characters, an item's name without
 * blanks and '/'. The store refuses others, since names are listed and logged without escaping.
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
 * Connect to the store of this machine (`host` NULL), or through it to the store of the machine named `host`: with
 * host "carol", ddx_store_lookup_item(id, "gps", NULL, 0) opens the item "carol:gps" of this machine's store, for
 * reading. That needs the program `catalog` on both machines; it copies the item while the item has a reader here.
 * `port` 0 means DDX_STORE_PORT. Tries for `timeout` seconds, so programs may start before the store. The store's
 * socket is in $DDX_DIR, or else in /run/ddx, $XDG_RUNTIME_DIR/ddx or /tmp/ddx-<uid>. A store is trusted only if root,
 * the caller's user or the folder's owner runs it, and if no other user can have made that folder or can change its
 * content. NULL and errno: ECONNREFUSED, no store; EPERM, only a store that is not trusted; EHOSTUNREACH, the catalog
 * has not heard from `host`; EOPNOTSUPP, no catalog runs here. The caller owns the result, until ddx_store_close().
 */
DDX_STORE_ID *ddx_store_open(const char *host, int port, double timeout);

/*
 * Close the connection and every item still open on it (pointers into frames become invalid). NULL is allowed.
 * Returns 0.
 */
int ddx_store_close(DDX_STORE_ID *id);

/*
 * Open a handle on the item `name`. With type NULL and size 0 the item must exist, and if this program declared a type
 * of the item's type name (DDX_STORE_TYPE), the declared struct must agree with it. If the program declared none, and
 * the type is not a plain C type such as "int", the library does not know the caller's struct: the handle shows the
 * item in its own layout (ddx_store_acquire(), ddx_store_read_direct(), ddx_store_loan(), ddx_store_field()), but
 * ddx_store_read() and ddx_store_write(), which copy the caller's struct, fail with -EPROTOTYPE. With a type and its
 * size the item is created if it does not exist. Opening neither reads nor writes: the first write makes the handle the
 * item's writer, the first read takes one reader's share of memory (one frame). Waits for the store's answer, 5 s at
 * most. A name "carol:gps" means item gps of the machine carol: the library asks the catalog for the item, which may
 * take 5 s more (EHOSTUNREACH: the catalog has not heard from that machine); an item that the catalog made before is
 * opened even then. NULL and errno: ENOENT, EPROTOTYPE, EMSGSIZE, ENOSPC, EDQUOT, ECONNREFUSED, EINVAL. The caller
 * owns the handle, until ddx_store_done_item() or ddx_store_close().
 */
DDX_STORE_ITEM *ddx_store_lookup_item(DDX_STORE_ID *id, const char *name, const char *type, int size);

/*
 * Open a handle for reading the item `name`, also before the item is created. A read waits for the item and its first
 * value; with DDX_IN_ORDER it gets every value from the first one on, however soon the writer begins. Until the item
 * is created, its type is "", it has no fields, no lookup finds it, and writing with the handle fails with -ENOENT.
 * The number of frames to keep is reduced if the store has no memory for all of them at creation. Otherwise as
 * ddx_store_lookup_item() with type NULL.
 */
DDX_STORE_ITEM *ddx_store_await_item(DDX_STORE_ID *id, const char *name);

/*
 * Close the handle: gives up its writer's role, its reader's share and its memory mappings. The item and its last value
 * stay in the store. NULL is allowed. Returns 0.
 */
int ddx_store_done_item(DDX_STORE_ITEM *item);

/*
 * Copy a value into *data (the caller's struct, in the layout that the caller declared) and its time of writing into
 * *ts (NULL allowed). The copy is never torn. The library must know the struct: this program has declared the item's
 * type, or gave type and size to ddx_store_lookup_item(); otherwise -EPROTOTYPE, and no value is consumed. The library
 * cannot see which of its structs the caller passes: compare ddx_store_item_type() if the item's name is user input.
 * The first read asks the store for a place among the readers and waits for the answer, 5 s at most. Errors:
 * -ETIMEDOUT, -EMSGSIZE, -EPROTOTYPE, -EINVAL; of the first read also -EBUSY, -EMFILE, -ECONNREFUSED. On failure *data
 * and *ts are unchanged.
 */
int ddx_store_read(DDX_STORE_ITEM *item, void *data, DDX_TIME *ts, double timeout, int tail);

/*
 * The address at which ddx_store_read_direct() shows the item, the same for the life of the handle; read-only memory.
 * Zeros before the first ddx_store_read_direct(). NULL and errno ENOMEM or EPROTOTYPE on failure.
 */
void *ddx_store_var_pointer(DDX_STORE_ITEM *item);

/*
 * As ddx_store_read(), without copying: the value appears at ddx_store_var_pointer() and cannot change before the next
 * ddx_store_read_direct() or ddx_store_done_item() of this handle. On failure the previous value is still shown. While
 * a call waits, the content is undefined for other threads.
 */
int ddx_store_read_direct(DDX_STORE_ITEM *item, DDX_TIME *ts, double timeout, int tail);

/* ---- Beyond the paper ---- */

/*
 * The write that a read waits for. "Seen" means: delivered to this handle, or written before its first read. Numbers
 * above 1: the n-th next write.
 */
enum ddx_tail {
    DDX_CURRENT = 0,  /* the newest value, now; waits only if no value was ever written */
    DDX_NEXT = 1,     /* the newest value not yet seen; waits for the next write if there is none */
    DDX_IN_ORDER = -1 /* the oldest kept value not yet seen: for readers that need every frame (a recorder) */
};

/*
 * Write a value: copies *data (layout as declared by the caller, or as created) into the store and wakes the readers.
 * If that layout is not known (see ddx_store_read()), fails with -EPROTOTYPE, and the handle does not become the
 * writer. `ts` is the time of the write, NULL for now. Never waits for a reader. The first call makes the handle the
 * writer, and waits for the store's answer, 5 s at most. Errors: -EEXIST, -ENOSPC, -EPROTOTYPE, -EMFILE, -ENOBUFS,
 * -ECONNREFUSED, -EINVAL, -ENOENT (see ddx_store_await_item()). ddx_store_short() counts the writes given up.
 */
int ddx_store_write(DDX_STORE_ITEM *item, const void *data, const DDX_TIME *ts);

/* One field's share of use, for items that use less than their struct declares (a small picture in a large array). */
struct ddx_extent {
    const char *field; /* name in the declaration, for example "y"; a field of the outermost struct */
    size_t bytes;      /* bytes used, from the start of the field; 0: none, if another field is used */
};

/* The item that ddx_store_create() makes. */
struct ddx_item_spec {
    const char *name;        /* of the item */
    const char *type;        /* of the type: 1 to DDX_NAME_MAX bytes */
    const char *declaration; /* C text such as "struct { int a; char b[64]; }"; NULL: the DDX_STORE_TYPE of `type` */
    size_t size;             /* sizeof the struct; checked against the declaration; 0: not checked */
    const struct ddx_extent *extents; /* fields used only in part; the item takes memory for the used part only */
    unsigned extent_count;
};

/*
 * Create the item, or take it over from a writer that has exited, and become its writer at once. If the layout stays
 * the same, the last whole value stays readable; sequence numbers continue. Fields that have an extent may get another
 * bound or extent than before (a camera that changes its format); everything else must equal the item's former type,
 * unless no program uses the item. On success the caller owns *item. Errors: -EEXIST, -ENOSPC, -EPROTOTYPE, -EMSGSIZE,
 * -EINVAL, -EMFILE, -EDQUOT, -ENOMEM, -ECONNREFUSED.
 */
int ddx_store_create(DDX_STORE_ID *id, const struct ddx_item_spec *spec, DDX_STORE_ITEM **item);

/* A value held by a reader. */
struct ddx_frame {
    const void *data;  /* the item's struct, in its own layout (ddx_store_field); undefined beyond a field's extent */
    DDX_TIME time;     /* of the write */
    uint64_t sequence; /* number of the write, from 1, without gaps, across writers */
    uint64_t missed;   /* writes between the previously seen one and this one, not delivered to this handle */
};

/*
 * Hold a value without copying it: the value cannot change until ddx_store_release(). One value at a time per handle
 * (-EBUSY); a second handle on the same item can hold a second one. Errors as ddx_store_read(), but the caller's struct
 * need not be known. On failure *frame is unchanged.
 */
int ddx_store_acquire(DDX_STORE_ITEM *item, struct ddx_frame *frame, double timeout, int tail);

/* Release the value of ddx_store_acquire(); frame->data is invalid afterwards. 0; -EINVAL if no value is held. */
int ddx_store_release(DDX_STORE_ITEM *item);

/*
 * Keep `frames` frames for this handle instead of one, so that DDX_IN_ORDER still finds older frames if the reader is
 * late. Each costs one frame of memory. Before the first read, any number is accepted, and the first read asks the
 * store for the memory: the read fails with -EBUSY if the budget has no room; the caller may then try a smaller number.
 * After the first read, the number can only grow; the call waits for the store's answer, 5 s at most. Errors: -EBUSY
 * (no room, nothing has changed), -EINVAL, -ECONNREFUSED.
 */
int ddx_store_keep(DDX_STORE_ITEM *item, unsigned frames);

/* Number of frames kept for this handle; fewer than requested only if the handle awaited the item. 0 for NULL. */
unsigned ddx_store_kept(const DDX_STORE_ITEM *item);

/*
 * Get a free frame (*data) to write in place, in the item's own layout. Its content is undefined (an older frame).
 * ddx_store_publish() or ddx_store_cancel() must follow. Waits and fails as ddx_store_write(); -EBUSY: already loaned.
 */
int ddx_store_loan(DDX_STORE_ITEM *item, void **data);

/*
 * Publish the loaned frame and wake the readers; `ts` as in ddx_store_write(). -EINVAL: no frame is loaned; -EEXIST:
 * another writer took over, and the frame is returned unpublished.
 */
int ddx_store_publish(DDX_STORE_ITEM *item, const DDX_TIME *ts);

/*
 * Number of this handle's writes that returned success but were lost: another writer had taken over while this program
 * was stopped and the store restarted. Final once a write has failed with -EEXIST.
 */
uint64_t ddx_store_lost(const DDX_STORE_ITEM *item);

/* Number of the item's newest write (by this handle or an earlier writer), if this handle is the writer; else 0. */
uint64_t ddx_store_written(const DDX_STORE_ITEM *item);

/*
 * Number of this handle's writes and loans that failed with -ENOBUFS (every frame is held: the store provides a frame
 * for each frame that a reader may hold, but after a restart it may not know all readers yet) or with -EMFILE (this
 * program has no descriptor for a new reader, and the store has not refused that reader yet).
 */
uint64_t ddx_store_short(const DDX_STORE_ITEM *item);

/* Return the loaned frame unpublished. 0; -EINVAL if no frame is loaned. */
int ddx_store_cancel(DDX_STORE_ITEM *item);

/* Facts about an item. */
struct ddx_item_info {
    char name[DDX_NAME_MAX + 1];
    char type[DDX_NAME_MAX + 1];
    uint64_t size;        /* bytes of the struct */
    uint64_t frame_bytes; /* memory of one frame (whole pages) */
    uint64_t bytes;       /* memory of the item now: all frames and the control pages */
    uint64_t reserved;    /* part of the budget: the above, and the memory that a change of writer needs */
    uint64_t sequence;    /* number of the last write, 0 if none */
    DDX_TIME time;        /* of the last write */
    uint32_t frames;      /* frames that exist */
    uint32_t readers;
    uint32_t epoch;      /* number of the current writer's term, from 1; 0 if never written */
    int32_t writer_pid;  /* 0 if the item has no writer now */
    uint64_t missed_max; /* frames missed by the reader that missed the most */
};

/* Facts about this handle's item. Waits for the store's answer, 5 s at most. 0, -ECONNREFUSED. */
int ddx_store_item_info(DDX_STORE_ITEM *item, struct ddx_item_info *info);

/*
 * Number of readers that the item of this writing handle has now. A reader counts once the store has memory for the
 * frames that the reader keeps: it gets each later value, unless it falls behind by more frames than it keeps. Does not
 * wait. -EINVAL if the handle does not write.
 */
int ddx_store_readers(const DDX_STORE_ITEM *item);

/*
 * For a writer that can delay its writes (a replay from a file): whether the next write or loan would overwrite a value
 * that a reader has not seen. The writer may ask again later, but only for a limited time: a reader may be stopped, or
 * read rarely. Does not wait. 1, 0; -EINVAL if the handle does not write; -EBUSY: loaned already.
 */
int ddx_store_outruns(const DDX_STORE_ITEM *item);

/* Facts about the store as a whole. */
struct ddx_store_info {
    uint64_t budget;   /* bytes, as given by -m */
    uint64_t bytes;    /* memory in use */
    uint64_t reserved; /* of the budget, never above it */
    uint32_t items, clients;
    int32_t pid;
    uint32_t restarts; /* times that the store's worker died or hung and was replaced; programs lose no frame by that */
};

/*
 * All items, sorted by name, in an array of *count that the caller frees with free(). `store` may be NULL.
 * Waits for the store's answer, 5 s at most. 0, -ECONNREFUSED, -ENOMEM.
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
    uint64_t offset;   /* from the start of the item; inside an array of structs: that in the first element */
    uint64_t used;     /* bytes in use, from the start of the field: bytes * count, or less if it has an extent */
    uint32_t children; /* DDX_KIND_STRUCT: number of the following fields that lie inside */
    uint32_t extent;   /* 1: the writer sets the number of bytes in use; the array bound is not part of the type */
};

/*
 * The i-th field of the item's type, from 0, or NULL past the last. A field named "" is an item that is not a struct.
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
 * Number of the newest write that this handle has seen. After a first read that timed out: number of the newest write
 * when the handle began to read; all later writes are delivered or counted as missed. 0: none.
 */
uint64_t ddx_store_seen(const DDX_STORE_ITEM *item);

/* Number of writes since this handle began to read that were not delivered to it. */
uint64_t ddx_store_missed(const DDX_STORE_ITEM *item);

/* The time now: CLOCK_MONOTONIC in ns. */
DDX_TIME ddx_time_now(void);

/* One clear line for a -errno of this library (or the negated errno), without a full stop. Never NULL. */
const char *ddx_error_text(int error);

/*
 * Explain why a type cannot be shared, in one line in text[bytes] (200 bytes are enough) that names the word at fault.
 * `type` is the name of a type that this program has declared (DDX_STORE_TYPE), or a declaration as in struct
 * ddx_item_spec. 0: the type can be shared, and the text is empty; -EINVAL; -ENOMEM. Does not wait.
 */
int ddx_type_problem(const char *type, char *text, size_t bytes);

#pragma GCC visibility pop
#ifdef __cplusplus
}
#endif
#endif
