/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sap.h"

#include <arpa/inet.h>
#include <string.h>

#include "bits.h"

#define VERSION_MASK 0xe0
#define VERSION 0x20
#define IPV6_ORIGIN 0x10
#define DELETION 0x04
#define ENCRYPTED 0x02
#define COMPRESSED 0x01
#define HEAD 4 /* bytes before the origin: flags, length of the authentication in words, hash */

static const char type[] = "application/sdp"; /* with its terminating zero in a message */

/* IPv4 groups by scope: RFC 2974, 3; RFC 2365 for the ranges. */
#define LINK 0xe0000000         /* 224.0.0.0/24 */
#define LOCAL 0xefff0000        /* 239.255.0.0/16 */
#define ORGANIZATION 0xefc00000 /* 239.192.0.0/14 */
#define SAP_LINK 0xe00000ff
#define SAP_LOCAL 0xefffffff
#define SAP_ORGANIZATION 0xefc3ffff
#define SAP_GLOBAL 0xe0027ffe /* 224.2.127.254 */

static const uint8_t *origin_bytes(const struct network_address *origin) {
    return network_is_ipv6(origin) ? origin->v6.sin6_addr.s6_addr : (const uint8_t *)&origin->v4.sin_addr;
}

size_t sap_write(const struct sap *sap, uint8_t *to) {
    size_t origin = network_is_ipv6(&sap->origin) ? 16 : 4;

    if (sap->size > SAP_MAX - HEAD - origin - sizeof type)
        return 0;
    uint8_t *at = to;
    *at++ = (uint8_t)(VERSION | (origin == 16 ? IPV6_ORIGIN : 0) | (sap->deletion ? DELETION : 0));
    *at++ = 0; /* no authentication */
    at = put16(at, sap->hash);
    memcpy(at, origin_bytes(&sap->origin), origin);
    memcpy(at + origin, type, sizeof type);
    at += origin + sizeof type;
    memcpy(at, sap->text, sap->size);
    return (size_t)(at - to) + sap->size;
}

static void take_origin(struct sap *sap, const uint8_t *data, size_t size) {
    sap->origin = (struct network_address){0};
    if (size == 16) {
        sap->origin.v6.sin6_family = AF_INET6;
        memcpy(&sap->origin.v6.sin6_addr, data, 16);
    } else {
        sap->origin.v4.sin_family = AF_INET;
        memcpy(&sap->origin.v4.sin_addr, data, 4);
    }
}

/* The type may be missing: then the text is SDP, and begins with its version. */
static bool skip_type(struct sap *sap) {
    static const char sdp[] = "v=0", origin_line[] = "o=";

    if (sap->size >= sizeof type && !memcmp(sap->text, type, sizeof type)) {
        sap->text += sizeof type;
        sap->size -= sizeof type;
        return true;
    }
    return (sap->size >= 3 && !memcmp(sap->text, sdp, 3)) ||
           (sap->deletion && (!sap->size || (sap->size >= 2 && !memcmp(sap->text, origin_line, 2))));
}

bool sap_parse(const uint8_t *data, size_t size, struct sap *sap) {
    if (size < HEAD || (data[0] & VERSION_MASK) != VERSION || data[0] & (ENCRYPTED | COMPRESSED))
        return false;
    size_t origin = data[0] & IPV6_ORIGIN ? 16 : 4, head = HEAD + origin + 4u * data[1];
    if (head > size)
        return false;
    sap->deletion = data[0] & DELETION;
    sap->hash = get16(data + 2);
    take_origin(sap, data + HEAD, origin);
    sap->text = data + head;
    sap->size = size - head;
    return !network_is_any(&sap->origin) && skip_type(sap) && (sap->deletion || sap->size) &&
           !memchr(sap->text, 0, sap->size);
}

uint16_t sap_hash(const uint8_t *text, size_t size) {
    uint32_t hash = 2166136261; /* FNV-1a */

    for (size_t i = 0; i < size; i++)
        hash = (hash ^ text[i]) * 16777619;
    hash = (hash >> 16 ^ hash) & UINT16_MAX;
    return hash ? (uint16_t)hash : 1;
}

void sap_group(const struct network_address *stream, struct network_address *group) {
    *group = (struct network_address){0};
    if (network_is_ipv6(stream)) { /* ff0X::2:7ffe, X the scope */
        struct in6_addr *to = &group->v6.sin6_addr;

        *group = *stream;
        *to = (struct in6_addr){.s6_addr = {0xff, stream->v6.sin6_addr.s6_addr[1] & 15, [13] = 2, 0x7f, 0xfe}};
    } else {
        uint32_t from = ntohl(stream->v4.sin_addr.s_addr);
        uint32_t to = (from & 0xffffff00) == LINK           ? SAP_LINK
                      : (from & 0xffff0000) == LOCAL        ? SAP_LOCAL
                      : (from & 0xfffc0000) == ORGANIZATION ? SAP_ORGANIZATION
                                                            : SAP_GLOBAL;

        group->v4.sin_family = AF_INET;
        group->v4.sin_addr.s_addr = htonl(to);
    }
    network_set_port(group, SAP_PORT);
}
