/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "describe.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "sdp.h"

static bool is_folder(const char *sdp) {
    size_t length = strlen(sdp);

    return length && sdp[length - 1] == '/';
}

/* The description's path in path[PATH_MAX]: the named file, or one in the folder. 0 or -ENAMETOOLONG. */
static int sdp_path(const struct sender *sender, char *path) {
    const char *name = sender->program.instance;
    bool folder = is_folder(sender->sdp);
    int size = snprintf(path, PATH_MAX, "%s%s%s", sender->sdp, folder ? name : "", folder ? ".sdp" : "");

    return size < PATH_MAX ? 0 : -ENAMETOOLONG;
}

static struct sdp description(const struct sender *sender, const struct encoded *encoded, const char *name) {
    const struct ddxvideo_geometry *geometry = &sender->encoder.geometry;

    return (struct sdp){.name = name,
                        .address = sender->outlet.receiver[0],
                        .ttl = (int)sender->outlet.ttl,
                        .type = sender->type,
                        .frame = encoded->data,
                        .size = encoded->size,
                        .rate = geometry->rate_num ? (double)geometry->rate_num / geometry->rate_den : 0};
}

/* Pictures are sent even if the description cannot be written. */
static void save_sdp(struct sender *sender, const struct encoded *encoded) {
    struct sdp sdp = description(sender, encoded, sender->program.instance);
    char path[PATH_MAX], crypto[SECURE_SDP_MAX];
    int error = sdp_path(sender, path);

    if (sender->secure) { /* in the file only, never in an announcement */
        secure_sdp(sender->secure, crypto);
        sdp.crypto = crypto;
    }
    if (!error)
        error = sdp_save(&sdp, path);
    explicit_bzero(crypto, sizeof crypto);
    if (error)
        say("-sdp %s: no description for players: %s", sender->sdp, strerror(-error));
}

/* The name begins with the machine's name, since players list the streams of all robots together. */
static void announce_sdp(struct sender *sender, const struct encoded *encoded) {
    char host[HOST_NAME_MAX + 1] = "", name[HOST_NAME_MAX + DDX_NAME_MAX + 20], text[SDP_MAX];

    gethostname(host, sizeof host - 1);
    snprintf(name, sizeof name, "%s %s", host, sender->program.instance);
    struct sdp sdp = description(sender, encoded, name);
    if (sdp_write(&sdp, text))
        announce_describe(&sender->announce, 0, sender->ssrc, text);
    if (!sender->ts.muxer)
        return;
    snprintf(name + strlen(name), sizeof name - strlen(name), " MPEG-TS");
    sdp.type = RTP_TS;
    sdp.address = sender->ts.outlet.receiver[0];
    if (sdp_write(&sdp, text))
        announce_describe(&sender->announce, 1, sender->ts.ssrc, text);
}

void describe(struct sender *sender, const struct encoded *encoded) {
    if (sender->sdp)
        save_sdp(sender, encoded);
    announce_sdp(sender, encoded);
}

/* An earlier sender of this instance may have left the file, with other settings. */
void describe_nothing(const struct sender *sender) {
    char path[PATH_MAX];

    if (sender->sdp && !sdp_path(sender, path))
        unlink(path);
}

void describe_end(const struct sender *sender) {
    if (sender->sdp && is_folder(sender->sdp))
        describe_nothing(sender);
}
