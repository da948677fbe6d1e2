/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxdecode: shows streams of ddxvideosend. */
#include <ddx_stats.h>
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "ddx_time.h"
#include "inlet.h"
#include "program.h"
#include "sdp.h"
#include "viewer.h"

/* ---- The list of announced streams ---- */

#define LIST_SECONDS 6 /* our senders announce each 5 s */
#define LOOK_UP_MS 100 /* a signal may come just before a wait */
#define ENTRIES 100    /* further announcements are not listed */
#define DATAGRAM 4096
#define BATCH 1024 /* datagrams between two checks of the time */

/* RFC 2974, 3: the groups of all scopes. */
static const char *const groups[] = {"239.255.255.255", "239.195.255.255", "224.2.127.254", "224.0.0.255",
                                     "ff02::2:7ffe",    "ff05::2:7ffe",    "ff08::2:7ffe",  "ff0e::2:7ffe"};

struct entry {
    uint16_t hash;
    struct network_address origin;
    struct sdp_stream stream;
    int64_t heard;
};

struct list {
    struct entry entry[ENTRIES];
    unsigned count;
};

static bool is_same(const struct entry *entry, const struct sap *sap) {
    return entry->hash == sap->hash && !memcmp(&entry->origin, &sap->origin, sizeof sap->origin);
}

static void take_announcement(struct list *list, const struct sap *sap, int64_t now) {
    struct sdp_stream stream;
    unsigned i = 0;

    while (i < list->count && !is_same(&list->entry[i], sap))
        i++;
    if (sap->deletion) {
        if (i < list->count)
            list->entry[i] = list->entry[--list->count];
    } else if (i < ENTRIES && sdp_read(sap->text, sap->size, &stream)) {
        list->entry[i] = (struct entry){sap->hash, sap->origin, stream, now};
        list->count += i == list->count;
    }
}

static void read_all(struct list *list, int fd) {
    uint8_t data[DATAGRAM];
    struct sap sap;
    ssize_t size;

    for (int i = 0; i < BATCH && (size = recv(fd, data, sizeof data, MSG_TRUNC)) >= 0; i++) {
        if (size <= DATAGRAM && sap_parse(data, (size_t)size, &sap))
            take_announcement(list, &sap, ddx_time_now());
    }
}

static int by_name(const void *a, const void *b) {
    return strcmp(((const struct entry *)a)->stream.name, ((const struct entry *)b)->stream.name);
}

static void print_list(struct list *list) {
    int64_t now = ddx_time_now();

    qsort(list->entry, list->count, sizeof *list->entry, by_name);
    for (unsigned i = 0; i < list->count; i++) {
        const struct sdp_stream *stream = &list->entry[i].stream;
        char host[NETWORK_TEXT_MAX];

        printf("%-24s %5u  %-8s %3.1f s  %s\n", network_host(&stream->address, host), network_port(&stream->address),
               stream->codec, (double)(now - list->entry[i].heard) / SECOND, stream->name);
    }
    if (!list->count)
        say("no stream is announced here; a sender to single receivers, or with -sap no, announces none");
}

/* Printed at once: users see that the program works, and scripts that no announcement is missed from now on. */
static void print_head(void) {
    printf("%-24s %5s  %-8s %5s  %s\n", "address", "port", "codec", "age", "name");
    fflush(stdout);
}

/* Joins the groups. Returns the number of successes; *error has the last failure. */
static unsigned join_all(int fd, const char *interface, int *error) {
    unsigned joined = 0;

    for (unsigned i = 0; i < sizeof groups / sizeof *groups; i++) {
        struct network_address group;
        int failed = network_parse(groups[i], SAP_PORT, &group) ? listen_join(fd, &group, interface) : -EINVAL;

        joined += !failed;
        *error = failed ? failed : *error;
    }
    return joined;
}

/*
 * Listen for LIST_SECONDS, or until a stop is requested, and print a line for each stream. `interface`: NULL: by the
 * routing table. Returns the exit status: failed if the announcements' port or groups are not available.
 */
static int list_run(const char *interface) {
    static struct list list;
    struct pollfd wanted = {.fd = listen_open(SAP_PORT), .events = POLLIN};
    int error = wanted.fd < 0 ? wanted.fd : 0;

    if (error || !join_all(wanted.fd, interface, &error)) {
        say("announcements at port %d: %s%s", SAP_PORT, strerror(-error), network_advice(error, interface));
        if (wanted.fd >= 0)
            close(wanted.fd);
        return EXIT_FAILED;
    }
    print_head();
    for (int64_t end = ddx_time_now() + LIST_SECONDS * SECOND; ddx_time_now() < end && !program_stopping();) {
        poll(&wanted, 1, LOOK_UP_MS);
        read_all(&list, wanted.fd);
    }
    read_all(&list, wanted.fd); /* datagrams from before the signal */
    close(wanted.fd);
    print_list(&list);
    return EXIT_OK;
}

/* ---- The program ---- */

static void read_key(struct guard *guard) {
    char text[KEY_FILE_ERROR_MAX];

    if (guard->path && !(guard->secure = secure_open(guard->path, text)))
        program_bad_usage("-key %s", text);
}

int main(int argc, char **argv) {
    bool list = false;
    static struct viewer viewer; /* 1 MiB; with initial values it would lie in the file */
    const struct option_entry options[] = {
        {"port", "PORT", "even port of the stream (default: 8000)", OPTION_NUMBER, &viewer.inlet.port, 2, 65532},
        {"group", "ADDRESS", "multicast group, IPv4 or IPv6 (default: " NETWORK_GROUP "), or none", OPTION_TEXT,
         &viewer.inlet.group, 0, 0},
        {"interface", "NAME", "network interface for the group (default: by the routing table)", OPTION_TEXT,
         &viewer.inlet.interface, 0, 0},
        {"key", "FILE", "show only streams that are encrypted with the key in this file", OPTION_TEXT,
         &viewer.guard.path, 0, 0},
        {"headless", NULL, "no window", OPTION_FLAG, &viewer.headless, 0, 0},
        {"name", "ITEM", "write the pictures into the store as well, as this video item", OPTION_NAME,
         &viewer.output.name, 0, 0},
        {"record", "FILE", "record the stream as it comes, as .avi or .mkv", OPTION_TEXT, &viewer.movie.path, 0, 0},
        {"print", NULL, "print number and latency of each frame shown", OPTION_FLAG, &viewer.print, 0, 0},
        {"conceal", NULL, "show damaged frames at once", OPTION_FLAG, &viewer.conceal, 0, 0},
        {"silent", NULL, "send no reports, on a machine that must not transmit", OPTION_FLAG, &viewer.silent, 0, 0},
        {"reorder", "MS", "time to wait for a packet that others overtook, without repair (default: 20)", OPTION_NUMBER,
         &viewer.patience, 0, 1000},
        {"list", NULL, "print the streams that are announced in the network, after 6 seconds", OPTION_FLAG, &list, 0,
         0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    viewer.inlet.fd[0] = viewer.inlet.fd[1] = -1;
    viewer.inlet.group = NETWORK_GROUP;
    viewer.inlet.port = NETWORK_PORT;
    viewer.patience = 20;
    viewer.program = (struct program){
        .name = "ddxdecode",
        .purpose = "Receives a stream of ddxvideosend, from its multicast group or sent to this machine alone, and\n"
                   "shows each frame as soon as its last packet is there. Missing packets are restored from repair\n"
                   "packets, on port + 2; meanwhile the last good picture stays. With -conceal, missing packets leave\n"
                   "marks in the picture, until the sender renews it. A restarted sender is followed. The sender\n"
                   "is sent reports on what is missing.",
        .notes =
            "The latency is from the capture to the picture; between two machines it is as exact as their clocks\n"
            "agree. Counters: lost.network = packets of the frame were lost, lost.join = before the first frame that\n"
            "can be shown, lost.refresh = refers to lost frames, lost.decode = nothing in it can be shown,\n"
            "lost.newer = a newer frame took its place on the screen. Packets: item `<instance>.packets`.\n"
            "The window closes on q and Escape.",
        .options = options,
    };
    program_start(&viewer.program, argc, argv);
    char text[NETWORK_ERROR_MAX];
    if (!strcmp(viewer.inlet.group, "none"))
        viewer.inlet.group = NULL;
    const char *wrong = inlet_parse(&viewer.inlet, text);
    if (!wrong && viewer.movie.path && !movie_is_possible(viewer.movie.path))
        wrong = "-record: a file .avi or .mkv is needed, and a ddxdecode built with libavformat";
    if (wrong)
        program_bad_usage("%s", wrong);
    read_key(&viewer.guard);
    if (viewer.program.check)
        return EXIT_OK;
    return list ? list_run(viewer.inlet.interface) : viewer_run(&viewer);
}
