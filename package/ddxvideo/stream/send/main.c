/* SPDX-License-Identifier: GPL-2.0-or-later */
/* ddxvideosend: sends a video item of the store over the network. */
#include <stdlib.h>
#include <string.h>

#include "sender.h"

#define RATIO_MAX 4

/* The error in -ts, or NULL. */
static const char *check_ts(const struct sender *sender) {
    long port = sender->ts.port, stream = sender->outlet.port;

    if (!port)
        return NULL;
    if (sender->key)
        return "MPEG-TS is not encrypted, so it cannot go together with -key";
    if (port % 2)
        return "an even number is needed";
    if (port >= stream && port < stream + NETWORK_PORTS)
        return "this port is reserved for the stream itself";
    return ts_is_possible() ? NULL : "a ddxvideosend with libavformat and its format mpegts is needed";
}

static bool parse_repair(struct sender *sender, const char *text) {
    char *end;

    sender->repairs = strcmp(text, "off") != 0;
    sender->ratio = sender->repairs ? strtod(text, &end) : 0;
    return !sender->repairs || (end != text && !*end && sender->ratio >= 0 && sender->ratio <= RATIO_MAX);
}

static void read_key(struct sender *sender) {
    char text[KEY_FILE_ERROR_MAX];

    if (!sender->key)
        return;
    sender->announce.off = true; /* for receivers with the key only */
    sender->secure = secure_open(sender->key, text);
    if (!sender->secure)
        program_bad_usage("-key %s", text);
}

int main(int argc, char **argv) {
    const char *codec = "h264", *preset = "superfast", *sap = "yes", *repair = "0";
    static struct sender sender; /* 1 MiB; with initial values it would lie in the file */
    const struct option_entry options[] = {
        {"name", "ITEM", "the video item to send (default: video)", OPTION_NAME, &sender.name, 0, 0},
        {"codec", "CODEC", "h264 or mpeg4 (default: h264)", OPTION_TEXT, &codec, 0, 0},
        {"wire", "KBIT", "kbit/s sent to each receiver, IP headers included (default: 400)", OPTION_NUMBER,
         &sender.wire, 50, 100000},
        {"bitrate", "KBIT", "kbit/s of encoded video, at most (default: 70 % of -wire)", OPTION_NUMBER, &sender.bitrate,
         16, 100000},
        {"repair", "RATIO", "repair packets a packet where no receiver reports, 0 to 4 (default: 0); off", OPTION_TEXT,
         &repair, 0, 0},
        {"preset", "PRESET", "of H.264: superfast, or ultrafast for slow processors (default: superfast)", OPTION_TEXT,
         &preset, 0, 0},
        {"port", "PORT", "even port of the stream (default: 8000)", OPTION_NUMBER, &sender.outlet.port, 2, 65532},
        {"group", "ADDRESS", "multicast group, IPv4 or IPv6 (default: " NETWORK_GROUP "), or none", OPTION_TEXT,
         &sender.outlet.group, 0, 0},
        {"to", "ADDRESS,...", "single receivers, as well as the group: 10.0.0.2, 10.0.0.2:8000, [fd00::2]:8000",
         OPTION_TEXT, &sender.outlet.to, 0, 0},
        {"ttl", "HOPS", "routers that a multicast packet may pass, plus one (default: 1)", OPTION_NUMBER,
         &sender.outlet.ttl, 0, 255},
        {"interface", "NAME", "network interface for the group (default: by the routing table)", OPTION_TEXT,
         &sender.outlet.interface, 0, 0},
        {"sdp", "FILE", "write a description for players; in FOLDER/: <instance>.sdp, until the sender stops",
         OPTION_TEXT, &sender.sdp, 0, 0},
        {"key", "FILE", "encrypt the stream with the key in this file; no announcements then", OPTION_TEXT, &sender.key,
         0, 0},
        {"ts", "PORT", "the same video as MPEG-TS over RTP as well, at this even port: for VLC", OPTION_NUMBER,
         &sender.ts.port, 2, 65534},
        {"sap", "yes|no", "announce the stream to the group's listeners: players, ddxdecode -list (default: yes)",
         OPTION_TEXT, &sap, 0, 0},
        {NULL, NULL, NULL, OPTION_FLAG, NULL, 0, 0},
    };

    sender.name = "video";
    sender.wire = 400;
    sender.outlet.fd[0] = sender.outlet.fd[1] = -1;
    sender.outlet.group = NETWORK_GROUP;
    sender.outlet.port = NETWORK_PORT;
    sender.outlet.ttl = 1;
    sender.program = (struct program){
        .name = "ddxvideosend",
        .purpose = "Sends a video item of the store over the network, as H.264 or MPEG-4 in RTP;\n"
                   "`ddxdecode` shows it. Frames are not delayed: each is encoded and sent as soon as it is\n"
                   "written. A frame that comes while another one is being encoded is lost if a newer one comes\n"
                   "first.",
        .notes = "PORT is for RTP; the next three are reserved for this stream (reports, repair packets), so a\n"
                 "second stream goes to PORT + 4. Counters: lost.store = a newer frame came before it was read,\n"
                 "lost.encode = the encoder failed, lost.network = no receiver was sent the whole frame,\n"
                 "lost.rate = -wire had nothing left for it. Packets, and why some were not sent: item\n"
                 "`<instance>.packets`.",
        .options = options,
    };
    program_start(&sender.program, argc, argv);
    sender.type = strcmp(codec, "mpeg4") ? RTP_H264 : RTP_MPEG4;
    if (sender.type == RTP_H264 && strcmp(codec, "h264") != 0)
        program_bad_usage("-codec %s: h264 or mpeg4 is needed", codec);
    sender.fast = !strcmp(preset, "ultrafast");
    if (!sender.fast && strcmp(preset, "superfast") != 0)
        program_bad_usage("-preset %s: superfast or ultrafast is needed", preset);
    if (!parse_repair(&sender, repair))
        program_bad_usage("-repair %s: a number from 0 to 4 is needed, or off", repair);
    if (sender.outlet.port % 2)
        program_bad_usage("-port %ld: an even number is needed", sender.outlet.port);
    const char *wrong_ts = check_ts(&sender);
    if (wrong_ts)
        program_bad_usage("-ts %ld: %s", sender.ts.port, wrong_ts);
    sender.announce.off = !strcmp(sap, "no");
    if (!sender.announce.off && strcmp(sap, "yes") != 0)
        program_bad_usage("-sap %s: yes or no is needed", sap);
    read_key(&sender);
    if (!strcmp(sender.outlet.group, "none"))
        sender.outlet.group = NULL;
    char text[NETWORK_ERROR_MAX];
    const char *wrong = outlet_parse(&sender.outlet, text);
    if (wrong)
        program_bad_usage("%s", wrong);
    return sender.program.check ? EXIT_OK : sender_run(&sender);
}
