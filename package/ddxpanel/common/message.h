/* SPDX-License-Identifier: GPL-2.0-or-later */
/*
 * Messages of the panel's two processes over a pair of sockets (SOCK_SEQPACKET) from before the fork. The
 * process of root believes nothing that it receives.
 */
#ifndef DDXPANEL_MESSAGE_H
#define DDXPANEL_MESSAGE_H

#include <netinet/in.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define MESSAGE_TEXT 1024
#define MESSAGE_WORDS 16
#define MESSAGE_PIECE 4096 /* bytes of output in a packet */

enum message_kind {
    MESSAGE_LOGIN, /* text: the passphrase, with its 0 byte */
    MESSAGE_ORDER, /* text: the words, each with its 0 byte */
    MESSAGE_ALIVE  /* a sign of life of the web process, which has no answer */
};

struct message_request {
    uint32_t kind;
    uint32_t session; /* of an order */
    uint32_t size;    /* bytes of the text */
    char address[INET6_ADDRSTRLEN];
    char text[MESSAGE_TEXT];
};

/* The answer to each login and order. An accepted order's has a socket with it, from which its output comes. */
struct message_answer {
    uint32_t status; /* as of HTTP: 200, 400, 401, 409, 429 */
    uint32_t wait;   /* ms until the next login of this address */
    char reason[64]; /* of 400 and 409 */
};

/* A packet of output: a byte 'o' and at most MESSAGE_PIECE bytes. The last one is this. */
struct message_end {
    char mark;   /* 'e' */
    uint8_t end; /* enum run_end, or MESSAGE_NOT_STARTED */
    int16_t status;
};

#define MESSAGE_NOT_STARTED 255

/* Whether a received request of `size` bytes has a kind, an address and texts that end. */
bool message_is_good(const struct message_request *request, size_t size);

/* The words of a good order. words[] ends with NULL. False: none, or more than MESSAGE_WORDS. */
bool message_words(const struct message_request *request, const char *words[MESSAGE_WORDS + 1]);

/* Send an answer, and a descriptor with it unless it is -1. 0 or -errno. */
int message_answer(int to, const struct message_answer *answer, int fd);

/* Receive an answer; *fd is -1 if no descriptor came with it. 0 or -errno; -EPIPE: the other process has exited. */
int message_receive(int from, struct message_answer *answer, int *fd);

#endif
