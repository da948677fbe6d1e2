/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "library_log.h"

#include <ctype.h>
#include <dc1394/log.h>
#include <pthread.h>
#include <string.h>

#include "program.h"

#define KNOWN 16 /* number of lines that are remembered, and not repeated */
#define LENGTH 200

/* Also called from the library's own thread. */
static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static char known[KNOWN][LENGTH];
static unsigned known_count;
static bool muted;
static unsigned unsaid; /* lines since the library was muted */

/* Ignores numbers, which differ from line to line: buffers, devices. */
static void without_numbers(char to[LENGTH], const char *from) {
    unsigned length = 0;

    for (; *from && length < LENGTH - 1; from++)
        if (!isdigit((unsigned char)*from))
            to[length++] = *from;
    to[length] = 0;
}

static bool is_new(const char *message) {
    char text[LENGTH];

    without_numbers(text, message);
    for (unsigned i = 0; i < known_count; i++)
        if (!strcmp(known[i], text))
            return false;
    if (known_count == KNOWN)
        return false;
    strcpy(known[known_count++], text);
    return true;
}

static void handle(dc1394log_t type, const char *message, void *user) {
    (void)type;
    (void)user;
    pthread_mutex_lock(&mutex);
    if (muted)
        unsaid++;
    else if (is_new(message))
        say("libdc1394: %.*s", (int)strcspn(message, "\n"), message);
    pthread_mutex_unlock(&mutex);
}

void library_log_begin(void) {
    dc1394_log_register_handler(DC1394_LOG_ERROR, handle, NULL);
    dc1394_log_register_handler(DC1394_LOG_WARNING, handle, NULL);
    dc1394_log_register_handler(DC1394_LOG_DEBUG, NULL, NULL);
}

unsigned library_log_mute(bool mute) {
    pthread_mutex_lock(&mutex);
    unsigned lines = unsaid;
    unsaid = 0;
    muted = mute;
    pthread_mutex_unlock(&mutex);
    return lines;
}

void library_log_forget(void) {
    pthread_mutex_lock(&mutex);
    known_count = 0;
    pthread_mutex_unlock(&mutex);
}
