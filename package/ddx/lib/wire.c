/* SPDX-License-Identifier: LGPL-2.1-or-later */
#include "wire.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <unistd.h>

union control_buffer {
    char bytes[CMSG_SPACE(DDX_FDS_MAX * sizeof(int))];
    struct cmsghdr align;
};

int ddx_send(int socket, const struct ddx_message *message, const struct ddx_layout *layout, const int *fds,
             unsigned fd_count) {
    struct ddx_message header = *message;
    union control_buffer control;
    struct iovec part[2] = {{&header, sizeof header}, {(void *)(uintptr_t)layout, 0}};
    struct msghdr envelope = {.msg_iov = part, .msg_iovlen = 2};

    header.version = DDX_WIRE_VERSION;
    if (layout)
        part[1].iov_len = ddx_layout_bytes(layout->field_count);
    header.layout_bytes = (uint32_t)part[1].iov_len;
    if (fd_count) {
        memset(&control, 0, sizeof control);
        envelope.msg_control = control.bytes;
        envelope.msg_controllen = CMSG_SPACE(fd_count * sizeof(int));
        struct cmsghdr *rights = CMSG_FIRSTHDR(&envelope);
        rights->cmsg_level = SOL_SOCKET;
        rights->cmsg_type = SCM_RIGHTS;
        rights->cmsg_len = CMSG_LEN(fd_count * sizeof(int));
        memcpy(CMSG_DATA(rights), fds, fd_count * sizeof(int));
    }
    ssize_t sent;
    do
        sent = sendmsg(socket, &envelope, MSG_NOSIGNAL | MSG_DONTWAIT);
    while (sent < 0 && errno == EINTR);
    if (sent >= 0)
        return 0;
    if (errno == ETOOMANYREFS)
        return -ETOOMANYREFS;
    return errno == EAGAIN || errno == ENOBUFS ? -EAGAIN : -EPIPE;
}

static void take_descriptors(struct msghdr *envelope, struct ddx_packet *packet) {
    unsigned taken = 0;

    for (struct cmsghdr *c = CMSG_FIRSTHDR(envelope); c; c = CMSG_NXTHDR(envelope, c)) {
        if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SCM_RIGHTS)
            continue;
        size_t count = (c->cmsg_len - CMSG_LEN(0)) / sizeof(int);
        for (size_t i = 0; i < count; i++) {
            int fd;

            memcpy(&fd, CMSG_DATA(c) + i * sizeof fd, sizeof fd);
            if (taken < DDX_FDS_MAX)
                packet->fd[taken++] = fd;
            else
                close(fd);
        }
    }
}

static int receive(int socket, struct ddx_packet *packet, int flags) {
    union control_buffer control;
    struct iovec part[2] = {{&packet->message, sizeof packet->message}, {packet->layout, sizeof packet->layout}};
    struct msghdr envelope = {
        .msg_iov = part, .msg_iovlen = 2, .msg_control = control.bytes, .msg_controllen = sizeof control.bytes};

    for (unsigned i = 0; i < DDX_FDS_MAX; i++)
        packet->fd[i] = -1;
    ssize_t got;
    /* A peer that dies with unread messages resets the connection. The kernel reports this once, before the peer's last
     * messages: these are still in the socket, and must not be lost. */
    do
        got = recvmsg(socket, &envelope, MSG_DONTWAIT | MSG_CMSG_CLOEXEC | flags);
    while (got < 0 && (errno == EINTR || errno == ECONNRESET));
    if (got < 0)
        return errno == EAGAIN ? 0 : -EPIPE;
    if (got == 0)
        return -EPIPE;
    packet->cut = envelope.msg_flags & MSG_CTRUNC;
    take_descriptors(&envelope, packet);
    struct ddx_message *m = &packet->message;
    if ((size_t)got < sizeof *m || (envelope.msg_flags & MSG_TRUNC) || m->version != DDX_WIRE_VERSION ||
        m->layout_bytes != (size_t)got - sizeof *m || !memchr(m->name, 0, sizeof m->name) ||
        !memchr(m->type, 0, sizeof m->type)) {
        ddx_packet_close(packet);
        return -EPROTO;
    }
    return 1;
}

int ddx_receive(int socket, struct ddx_packet *packet) {
    return receive(socket, packet, 0);
}

int ddx_peek(int socket, struct ddx_packet *packet) {
    return receive(socket, packet, MSG_PEEK);
}

void ddx_discard(int socket) {
    char first;

    /* Without room for descriptors the kernel closes them. */
    while (recv(socket, &first, sizeof first, MSG_DONTWAIT) < 0 && errno == EINTR)
        continue;
}

const struct ddx_layout *ddx_packet_layout(const struct ddx_packet *packet) {
    const struct ddx_layout *layout = (const struct ddx_layout *)(const void *)packet->layout;

    return ddx_layout_valid(layout, packet->message.layout_bytes) ? layout : NULL;
}

int ddx_packet_take(struct ddx_packet *packet, unsigned i) {
    int fd = packet->fd[i];

    packet->fd[i] = -1;
    return fd;
}

void ddx_packet_close(struct ddx_packet *packet) {
    for (unsigned i = 0; i < DDX_FDS_MAX; i++)
        if (packet->fd[i] >= 0)
            close(ddx_packet_take(packet, i));
}

bool ddx_socket_path(unsigned i, int port, char *path, size_t bytes) {
    const char *chosen = getenv("DDX_DIR"), *session = getenv("XDG_RUNTIME_DIR");
    char folder[64];

    if (chosen) {
        /* For tests, and several stores side by side: only this folder. */
        return i == 0 && snprintf(path, bytes, "%s/store-%d", chosen, port) < (int)bytes;
    }
    snprintf(folder, sizeof folder, "/tmp/ddx-%u", (unsigned)getuid());
    switch (i) {
    case 0: return snprintf(path, bytes, "/run/ddx/store-%d", port) < (int)bytes;
    case 1:
        return snprintf(path, bytes, "%s%s/store-%d", session ? session : folder, session ? "/ddx" : "", port) <
               (int)bytes;
    case 2: return session && snprintf(path, bytes, "%s/store-%d", folder, port) < (int)bytes;
    default: return false;
    }
}

/* ---- Which stores to trust ---- */

/* Cut off the last part of a path; false: there is no folder above it. */
static bool go_up(char *path) {
    char *slash = strrchr(path, '/');

    if (!slash || slash == path)
        return false;
    *slash = 0;
    return true;
}

/* Any user may create files there; with the sticky bit, users cannot replace files of other users. */
static bool is_common(const struct stat *status) {
    return status->st_mode & S_IWOTH;
}

int ddx_folder_owner(const char *path, uid_t *owner) {
    char folder[sizeof(((struct sockaddr_un *)0)->sun_path)];
    struct stat status, above;

    snprintf(folder, sizeof folder, "%s", path);
    if (!go_up(folder))
        return -EINVAL;
    if (lstat(folder, &status))
        return -errno;
    if (!S_ISDIR(status.st_mode) || (is_common(&status) && !(status.st_mode & S_ISVTX)))
        return -EPERM;
    *owner = status.st_uid;
    if (status.st_uid == 0 || status.st_uid == getuid() || !go_up(folder))
        return 0;
    /* The system may have made it for the store's user, as /run/ddx; but in a common folder that user made it. */
    return stat(folder, &above) || is_common(&above) ? -EPERM : 0;
}

/* Whether the other side of the connection runs as root, as this user, or as the owner of the socket's folder. */
static bool is_trusted(int socket, uid_t owner) {
    struct ucred peer;
    socklen_t length = sizeof peer;

    return !getsockopt(socket, SOL_SOCKET, SO_PEERCRED, &peer, &length) &&
           (peer.uid == 0 || peer.uid == getuid() || peer.uid == owner);
}

/* ---- Connections ---- */

/* Connect to the store at this address. -ENOENT or similar: no store; -EPERM: the store is not trusted. */
static int connect_to(const struct sockaddr_un *address) {
    uid_t owner;
    int result = ddx_folder_owner(address->sun_path, &owner);

    if (result)
        return result;
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return -errno;
    if (connect(fd, (const struct sockaddr *)address, sizeof *address))
        result = -ECONNREFUSED;
    else if (!is_trusted(fd, owner))
        result = -EPERM;
    if (!result)
        return fd;
    close(fd);
    return result;
}

int ddx_connect(int port) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int result = -ECONNREFUSED;

    for (unsigned i = 0; ddx_socket_path(i, port, address.sun_path, sizeof address.sun_path); i++) {
        int fd = connect_to(&address);

        if (fd >= 0 || fd == -EMFILE || fd == -ENFILE)
            return fd;
        if (fd == -EPERM)
            result = -EPERM;
    }
    return result;
}
