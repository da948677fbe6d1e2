/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "answer.h"

#include <sys/socket.h>

void answer_media(struct answer *answer, const uint8_t *data, size_t size, const struct sockaddr_storage *from,
                  int64_t now) {
    struct network_address address;
    struct rtp_packet packet;

    if (answer->silent || !rtp_parse(data, size, &packet) || !network_from(&address, from))
        return;
    if (!answer->known || answer->reporter.media_ssrc != packet.ssrc)
        reporter_init(&answer->reporter, answer->ssrc, packet.ssrc,
                      network_overhead(&address) + (answer->secure ? SECURE_REPORT_GROWTH : 0), now);
    answer->known = packet.has_count;
    answer->to = *from;
    reporter_media(&answer->reporter, now, packet.sequence, packet.time, packet.marker);
}

void answer_repair(struct answer *answer, const uint8_t *data, size_t size, int64_t now) {
    struct repair_packet packet;

    if (answer->known && repair_parse(data, size, &packet) && packet.media_ssrc == answer->reporter.media_ssrc)
        reporter_repair(&answer->reporter, now, packet.sequence);
}

static bool send_report(const struct answer *answer, int fd, uint8_t *data, size_t size) {
    socklen_t length = answer->to.ss_family == AF_INET ? sizeof(struct sockaddr_in) : sizeof(struct sockaddr_in6);

    if (answer->secure && secure_protect_report(answer->secure, data, &size))
        return false;
    return sendto(fd, data, size, MSG_DONTWAIT | MSG_NOSIGNAL, (const struct sockaddr *)&answer->to, length) >= 0;
}

void answer_send(struct answer *answer, int fd, const struct restore *restore, bool refresh, int64_t now) {
    uint8_t data[REPORT_MAX + SECURE_ROOM] __attribute__((aligned(4)));

    if (!answer->known || restore->ssrc != answer->reporter.media_ssrc)
        return;
    answer->reporter.refresh = refresh;
    size_t size = reporter_next(&answer->reporter, now, restore, data);
    if (size)
        answer->count[send_report(answer, fd, data, size) ? ANSWER_REPORTS : ANSWER_LOST]++;
}

int64_t answer_deadline(const struct answer *answer, const struct restore *restore) {
    if (!answer->known || restore->ssrc != answer->reporter.media_ssrc)
        return INT64_MAX;
    return reporter_deadline(&answer->reporter, restore);
}
