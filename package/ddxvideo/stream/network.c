/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "network.h"

#include <arpa/inet.h>
#include <net/if.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool network_parse(const char *text, long port, struct sockaddr_in *address) {
    char host[INET_ADDRSTRLEN];
    const char *colon = strchr(text, ':');
    size_t length = colon ? (size_t)(colon - text) : strlen(text);

    if (length >= sizeof host)
        return false;
    memcpy(host, text, length);
    host[length] = 0;
    if (colon) {
        char *end;

        port = strtol(colon + 1, &end, 10);
        if (end == colon + 1 || *end)
            return false;
    }
    *address = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    return port > 0 && port <= UINT16_MAX && inet_pton(AF_INET, host, &address->sin_addr) == 1;
}

bool network_is_group(const struct sockaddr_in *address) {
    return IN_MULTICAST(ntohl(address->sin_addr.s_addr));
}

const char *network_text(const struct sockaddr_in *address, char *text) {
    char host[INET_ADDRSTRLEN];

    inet_ntop(AF_INET, &address->sin_addr, host, sizeof host);
    snprintf(text, NETWORK_ERROR_MAX, "%s:%u", host, ntohs(address->sin_port));
    return text;
}

int network_interface(const char *name) {
    return (int)if_nametoindex(name);
}
