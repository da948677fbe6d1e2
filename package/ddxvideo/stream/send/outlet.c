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
        return fail(text, "-group", outlet->group,
                    "a multicast address such as " NETWORK_GROUP " or ff15::5 is needed, or none");
    for (const char *at = outlet->to; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        char one[NETWORK_TEXT_MAX];

        snprintf(one, sizeof one, "%.*s", (int)strcspn(at, ","), at);
        if (!add(outlet, one))
            return fail(text, "-to", at,
                        "addresses are needed, such as 10.0.0.2, 10.0.0.2:8000, [fd00::2]:8000 or fe80::2%eth0, with "
                        "commas between");
    }
    return outlet->receivers ? NULL : "nobody to send to: give -to or -group";
}

/* ---- Sockets ---- */

/*
 * To send there has to be a port of ours. What is sent to it is let in for this address only, and nobody can be it:
 * a stranger that tries the port gets the answer that it is closed.
 */
static struct network_address nowhere(bool ipv6) {
    if (ipv6)
        return (struct network_address){.v6 = {.sin6_family = AF_INET6, .sin6_addr.s6_addr[0] = 0xff}};
    return (struct network_address){.v4 = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_UNSPEC_GROUP)}};
}

static bool set(int fd, int level, int option, int value) {
    return !setsockopt(fd, level, option, &value, sizeof value);
}

static bool choose_interface(int fd, bool ipv6, const char *name) {
    int index = (int)network_interface(name);
    const struct ip_mreqn from = {.imr_ifindex = index};

    if (!index)
        return false;
    return ipv6 ? set(fd, IPPROTO_IPV6, IPV6_MULTICAST_IF, index)
                : !setsockopt(fd, IPPROTO_IP, IP_MULTICAST_IF, &from, sizeof from);
}

static const char *open_socket(struct outlet *outlet, bool ipv6, char *text) {
    const struct network_address own = nowhere(ipv6);
    const char *kind = ipv6 ? "IPv6" : "IPv4";
    int fd = socket(own.any.sa_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);

    if (fd < 0)
        return fail(text, "socket for", kind, strerror(errno));
    outlet->fd[ipv6 ? OUTLET_IPV6 : OUTLET_IPV4] = fd;
    if (ipv6)
        set(fd, IPPROTO_IPV6, IPV6_V6ONLY, 1);
    if (bind(fd, &own.any, network_size(&own)))
        return fail(text, "socket for", kind, strerror(errno));
    if (ipv6)
        set(fd, IPPROTO_IPV6, IPV6_MULTICAST_HOPS, (int)outlet->ttl);
    else
        set(fd, IPPROTO_IP, IP_MULTICAST_TTL, (int)outlet->ttl);
    if (outlet->interface && !choose_interface(fd, ipv6, outlet->interface))
        return fail(text, "-interface", outlet->interface, "there is none of this name");
    return NULL;
}

static int fd_for(const struct outlet *outlet, const struct network_address *receiver) {
    return outlet->fd[network_is_ipv6(receiver) ? OUTLET_IPV6 : OUTLET_IPV4];
}

const char *outlet_open(struct outlet *outlet, char *text) {
    const char *wrong = NULL;

    for (unsigned i = 0; i < outlet->receivers && !wrong; i++) {
        struct network_address *receiver = &outlet->receiver[i];

        if (network_find_zone(receiver))
            wrong = fail(text, "interface", receiver->zone, "there is none of this name");
        else if (fd_for(outlet, receiver) < 0)
            wrong = open_socket(outlet, network_is_ipv6(receiver), text);
    }
    return wrong;
}

void outlet_close(struct outlet *outlet) {
    for (unsigned i = 0; i < OUTLET_SOCKETS; i++) {
        if (outlet->fd[i] >= 0)
            close(outlet->fd[i]);
        outlet->fd[i] = -1;
    }
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
        const struct network_address *receiver = &outlet->receiver[i];
        ssize_t sent = sendto(fd_for(outlet, receiver), packet, size, MSG_NOSIGNAL, &receiver->any,
                              network_size(receiver));

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

bool outlet_send_to(const struct outlet *outlet, const struct network_address *to, const uint8_t *data, size_t size) {
    return sendto(fd_for(outlet, to), data, size, MSG_NOSIGNAL, &to->any, network_size(to)) == (ssize_t)size;
}

bool outlet_origin(const struct outlet *outlet, const struct network_address *to, struct network_address *own) {
    struct sockaddr_storage name;
    socklen_t size = sizeof name;
    int fd = socket(to->any.sa_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);

    if (fd < 0)
        return false;
    if (outlet->interface)
        choose_interface(fd, network_is_ipv6(to), outlet->interface);
    /* Nothing is sent: the kernel only looks for the way. */
    bool found = !connect(fd, &to->any, network_size(to)) && !getsockname(fd, (struct sockaddr *)&name, &size) &&
                 network_from(own, &name) && !network_is_any(own);
    close(fd);
    return found;
}
