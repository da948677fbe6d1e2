/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "message.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

bool message_is_good(const struct message_request *request, size_t size) {
    return size >= offsetof(struct message_request, text) && request->kind <= MESSAGE_ALIVE && request->size &&
           request->size <= MESSAGE_TEXT && size == offsetof(struct message_request, text) + request->size &&
           !request->text[request->size - 1] && memchr(request->address, 0, sizeof request->address);
}

bool message_words(const struct message_request *request, const char *words[MESSAGE_WORDS + 1]) {
    const char *end = request->text + request->size;
    unsigned count = 0;

    for (const char *at = request->text; at < end && count < MESSAGE_WORDS; at += strlen(at) + 1)
        words[count++] = at;
    words[count] = NULL;
    return count && words[count - 1] + strlen(words[count - 1]) + 1 == end;
}

union room {
    struct cmsghdr header;
    char bytes[CMSG_SPACE(sizeof(int))];
};

int message_answer(int to, const struct message_answer *answer, int fd) {
    struct iovec part = {(void *)answer, sizeof *answer};
    union room room = {.bytes = {0}};
    struct msghdr message = {.msg_iov = &part, .msg_iovlen = 1};

    if (fd >= 0) {
        message.msg_control = &room;
        message.msg_controllen = sizeof room.bytes;
        room.header = (struct cmsghdr){CMSG_LEN(sizeof fd), SOL_SOCKET, SCM_RIGHTS};
        memcpy(CMSG_DATA(&room.header), &fd, sizeof fd);
    }
    return sendmsg(to, &message, MSG_NOSIGNAL) < 0 ? -errno : 0;
}

int message_receive(int from, struct message_answer *answer, int *fd) {
    struct iovec part = {answer, sizeof *answer};
    union room room;
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = &room, .msg_controllen = sizeof room.bytes};
    ssize_t got = recvmsg(from, &message, MSG_CMSG_CLOEXEC);
    const struct cmsghdr *header = got < 0 ? NULL : CMSG_FIRSTHDR(&message);

    *fd = -1;
    if (header && header->cmsg_level == SOL_SOCKET && header->cmsg_type == SCM_RIGHTS &&
        header->cmsg_len == CMSG_LEN(sizeof *fd))
        memcpy(fd, CMSG_DATA(header), sizeof *fd);
    if (got == (ssize_t)sizeof *answer)
        return 0;
    int error = got < 0 ? -errno : got ? -EBADMSG : -EPIPE;
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
    return error;
}
