/* SPDX-License-Identifier: GPL-2.0-or-later */
/* decode: shows streams of ddxvideosend. */
#include <string.h>

#include "list.h"
#include "viewer.h"

static void read_key(struct guard *guard) {
    char text[KEY_FILE_ERROR_MAX];

    if (guard->path && !(guard->secure = secure_open(guard->path, text)))
        program_bad_usage("-key %s", text);
}

int main(int argc, char **argv) {
    bool list = false;
    static struct viewer viewer = {.inlet = {.fd = {-1, -1}, .group = NETWORK_GROUP, .port = NETWORK_PORT},
                                   .patience = 20};
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
        {"silent", NULL, "send no reports, on a machine that must not transmit", OPTION_FLAG, &viewer.answer.silent, 0,
         0},
        {"reorder", "MS", "time to wait for a packet that others overtook, without repair (default: 20)", OPTION_NUMBER,
         &viewer.patience, 0, 1000},
        {"list", NULL, "print the streams that are announced in the network, after 6 seconds", OPTION_FLAG, &list, 0,
         0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    viewer.program = (struct program){
        .name = "decode",
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
        wrong = "-record: a file .avi or .mkv is needed, and a decode built with libavformat";
    if (wrong)
        program_bad_usage("%s", wrong);
    read_key(&viewer.guard);
    if (viewer.program.check)
        return EXIT_OK;
    return list ? list_run(viewer.inlet.interface) : viewer_run(&viewer);
}
