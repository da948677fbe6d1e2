/* SPDX-License-Identifier: LGPL-2.1-or-later */
/*
 * Messages between programs and the store: SOCK_SEQPACKET, one connection per item handle, memory files as SCM_RIGHTS.
 * No message is on the frame path.
 *
 * A handle's life:
 *   OPEN                            -> OPENED (layout) or an error
 *   CLAIM (layout)                  -> CLAIMED (control, notice), SLOT..., READER...           become the writer
 *   READY (slot, or an error)       one for each slot mapped and sealed, the control file as slot DDX_NO_SLOT
 *                                   -> DONE when all are, and the readers were notified
 *   ATTACH (frames to keep)         -> ATTACHED (pin), then as below                           become a reader
 * and unasked from the store:
 *   EPOCH (layout, control), SLOT...   to a reader: a writer's term begins (or has begun before)
 *   SLOT                               an added slot; sent to the writer a second time, without the file, when the
 *                                      readers know the slot
 *   READER (pin), READER_GONE          to the writer; the notice's version changes after READER was sent
 *                                      -> TAKEN: only then the reader gets further messages, such as ATTACHED; with an
 *                                         error, the reader's request fails with it (or the claim, if one is pending)
 * After a restart of the store, instead of OPEN:
 *   OFFER (layout, control, notice and its version), OFFER_SLOT..., OFFER_PIN, OFFER_END -> OFFERED
 * where -EEXIST means that another writer was admitted; with FLAG_WRITER, after which of its frames.
 *
 * Messages are numbered in both directions. The store's worker may die between acting on a request and its reply, or
 * between the reply and the commit; the next worker handles no request a second time, and a repeated reply has the
 * same number as before.
 */
#ifndef DDX_WIRE_H
#define DDX_WIRE_H

#include <assert.h>
#include <stdbool.h>
#include <sys/types.h>

#include "type.h"

#define DDX_WIRE_VERSION 2u

enum ddx_operation {
    DDX_OPEN = 1,
    DDX_OPENED,
    DDX_CLAIM,
    DDX_CLAIMED,
    DDX_READY,
    DDX_ATTACH,
    DDX_ATTACHED,
    DDX_EPOCH,
    DDX_SLOT,
    DDX_READER,
    DDX_READER_GONE,
    DDX_TAKEN,
    DDX_DONE,
    DDX_OFFER,
    DDX_OFFER_SLOT,
    DDX_OFFER_PIN,
    DDX_OFFER_END,
    DDX_OFFERED,
    DDX_INFO,
    DDX_LIST,
    DDX_ITEM,
    DDX_LISTED,
};

/* Flags of OPEN and OFFER; and the role of the handle that a SLOT is for (both: see above). AWAIT: the client opens an
 * item that need not exist yet; it sends no layout, and gets the type with the first EPOCH. */
#define DDX_FLAG_CREATE 1u
#define DDX_FLAG_WRITER 2u
#define DDX_FLAG_READER 4u
#define DDX_FLAG_AWAIT 8u

struct ddx_message {
    uint32_t operation;
    int32_t status; /* 0 or -errno, in replies */
    uint32_t version, flags;
    uint32_t epoch;
    uint32_t index;  /* slot, or reader; of EPOCH: number of SLOTs that follow at once */
    uint32_t frames; /* slots to come; frames to keep */
    uint32_t readers;
    int32_t pid;
    uint32_t layout_bytes; /* of the layout after this header */
    uint64_t sequence;
    uint64_t size; /* of the struct; of READER: the pin page's number, as ddx_memory_number() gives it */
    uint64_t frame_bytes, bytes, reserved;
    uint64_t missed; /* of EPOCH: the number of the last frame of the epoch before */
    int64_t time;
    uint64_t number; /* of this message on this connection, from 1; 0: not numbered */
    char name[DDX_NAME_MAX + 1], type[DDX_NAME_MAX + 1];
};

static_assert(sizeof(struct ddx_message) == 232, "the same for i386 and x86_64");
static_assert(sizeof(struct ddx_layout_field) == 96 && sizeof(struct ddx_layout) == 16, "likewise");

#define DDX_FDS_MAX 2u

/* A message with room for the largest layout and all descriptors. */
struct ddx_packet {
    struct ddx_message message;
    _Alignas(8) char layout[sizeof(struct ddx_layout) + DDX_FIELDS_MAX * sizeof(struct ddx_layout_field)];
    int fd[DDX_FDS_MAX]; /* received; the receiver must close them; -1: none */
    bool cut;            /* descriptors were lost, because this process has no free one */
};

/*
 * Send without waiting; layout may be NULL; the caller keeps the descriptors. 0, -EAGAIN (the peer's socket is full),
 * -ETOOMANYREFS (this user has too many unread descriptors in sockets, see unix(7)), -EPIPE (the peer disconnected).
 */
int ddx_send(int socket, const struct ddx_message *message, const struct ddx_layout *layout, const int *fds,
             unsigned fd_count);

/* Receive without waiting. 1: a message; 0: none; -EPIPE: the peer disconnected; -EPROTO: the message is invalid. */
int ddx_receive(int socket, struct ddx_packet *packet);

/* The same, but the message remains in the socket until ddx_discard(). */
int ddx_peek(int socket, struct ddx_packet *packet);
void ddx_discard(int socket);

/* The layout in a received packet, or NULL if there is none or it is invalid. */
const struct ddx_layout *ddx_packet_layout(const struct ddx_packet *packet);

/* Take descriptor i out of a packet; -1 if there is none. */
int ddx_packet_take(struct ddx_packet *packet, unsigned i);

/* Close the descriptors that were not taken. */
void ddx_packet_close(struct ddx_packet *packet);

/* Path number i of the store's socket, in order of preference; false if i is past the last. */
bool ddx_socket_path(unsigned i, int port, char *path, size_t bytes);

/* ---- Which stores to trust: a program works with the content of the memory that the store hands out ---- */

/*
 * The owner of the folder of this socket. 0; -ENOENT or similar: no folder; -EPERM: another user could have made the
 * folder, or can replace its content.
 */
int ddx_folder_owner(const char *path, uid_t *owner);

/*
 * Connect to the store, without waiting. Socket; -ECONNREFUSED: no store; -EPERM: only a store that is not
 * trusted; or another -errno, such as -EMFILE.
 */
int ddx_connect(int port);

#endif
