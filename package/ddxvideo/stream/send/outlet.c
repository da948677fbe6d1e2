/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "outlet.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static const char *fail(char *text, const char *what, const char *value, const char *why) {
    snprintf(text, NETWORK_ERROR_MAX, "%s %.80s: %s", what, value, why);
    return text;
}

static bool add(struct outlet *outlet, const char *text) {
    return outlet->receivers < OUTLET_RECEIVERS &&
           network_parse(text, outlet->port, &outlet->receiver[outlet->receivers++]);
}

const char *outlet_parse(struct outlet *outlet, char *text) {
    outlet->receivers = 0;
    if (outlet->group && (!add(outlet, outlet->group) || !network_is_group(&outlet->receiver[0])))
        return fail(text, "-group", outlet->group, "a multicast address such as " NETWORK_GROUP " is needed, or none");
    for (const char *at = outlet->to; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        char one[40];

        snprintf(one, sizeof one, "%.*s", (int)strcspn(at, ","), at);
        if (!add(outlet, one))
            return fail(text, "-to", at,
                        "addresses are needed, such as 10.0.0.2 or 10.0.0.2:8000, with commas between");
    }
    return outlet->receivers ? NULL : "nobody to send to: give -to or -group";
}

const char *outlet_open(struct outlet *outlet, char *text) {
    outlet->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (outlet->fd < 0)
        return fail(text, "socket", "", strerror(errno));
    /* To send there has to be a port of ours. What is sent to it is let in for this address only, and nobody can be it:
     * whoever asks is told that the port is closed. */
    const struct sockaddr_in nowhere = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_UNSPEC_GROUP)};
    if (bind(outlet->fd, (const struct sockaddr *)&nowhere, sizeof nowhere))
        return fail(text, "socket", "", strerror(errno));
    int ttl = (int)outlet->ttl;
    setsockopt(outlet->fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
    if (outlet->interface) {
        struct ip_mreqn from = {.imr_ifindex = network_interface(outlet->interface)};

        if (!from.imr_ifindex || setsockopt(outlet->fd, IPPROTO_IP, IP_MULTICAST_IF, &from, sizeof from))
            return fail(text, "-interface", outlet->interface, "there is none of this name");
    }
    return NULL;
}

void outlet_close(struct outlet *outlet) {
    if (outlet->fd >= 0)
        close(outlet->fd);
    outlet->fd = -1;
}

static enum outlet_loss reason(int error) {
    switch (error) {
    case EAGAIN:
    case ENOBUFS:
    case ENOMEM: return OUTLET_BUSY;
    case ENETUNREACH:
    case EHOSTUNREACH:
    case ENETDOWN:
    case ENODEV:
    case EADDRNOTAVAIL:
    case EINVAL: /* a packet for elsewhere, from an interface without an address */
    case EPERM: return OUTLET_ROUTE;
    default: return OUTLET_OTHER;
    }
}

unsigned outlet_send(struct outlet *outlet, const uint8_t *packet, size_t size) {
    unsigned missed = 0;

    for (unsigned i = 0; i < outlet->receivers; i++) {
        ssize_t sent = sendto(outlet->fd, packet, size, MSG_NOSIGNAL, (struct sockaddr *)&outlet->receiver[i],
                              sizeof outlet->receiver[i]);

        if (sent == (ssize_t)size) {
            outlet->packets++;
            outlet->bytes += size;
            continue;
        }
        outlet->error = sent < 0 ? errno : EMSGSIZE;
        outlet->lost[reason(outlet->error)]++;
        missed |= 1u << i;
    }
    return missed;
}
