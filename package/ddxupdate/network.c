/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "network.h"

#include <arpa/inet.h>
#include <dirent.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { PATIENCE = 5 }; /* s */

/* Whether one of the file's lines has this word, counted from 0, and besides it `other`, if that is not NULL. */
static bool has_word(const char *path, const char *word, int at, const char *other, int other_at) {
    FILE *file = fopen(path, "re");
    char line[512], *rest = NULL;
    bool found = false;

    while (file && !found && fgets(line, sizeof line, file)) {
        bool fits = false, other_fits = !other;
        int number = 0;
        for (const char *text = strtok_r(line, " \t\n", &rest); text; text = strtok_r(NULL, " \t\n", &rest), number++) {
            fits |= number == at && !strcmp(text, word);
            other_fits |= other && number == other_at && !strcmp(text, other);
        }
        found = fits && other_fits;
    }
    if (file)
        fclose(file);
    return found;
}

/* An IPv4 address brings a route for its network. */
static bool has_address(const struct place *place, const char *name) {
    char path[PATH_MAX];

    place_path(place, "/proc/net/route", path);
    if (has_word(path, name, 0, NULL, 0))
        return true;
    place_path(place, "/proc/net/if_inet6", path);
    return has_word(path, name, 5, "00", 3); /* the scope: global */
}

static bool is_other(const char *name) {
    return name[0] == '.' || !strcmp(name, "lo") || !strncmp(name, "sit", 3) || !strncmp(name, "tunl", 4);
}

void network_look(const struct place *place, struct network *network) {
    char folder[PATH_MAX], path[PATH_MAX + 300], text[8];

    network->count = 0;
    place_path(place, "/sys/class/net", folder);
    DIR *names = opendir(folder);
    for (const struct dirent *entry; names && network->count < LINKS_MAX && (entry = readdir(names));) {
        if (is_other(entry->d_name) || strlen(entry->d_name) >= LINK_NAME)
            continue;
        struct link *link = &network->list[network->count++];
        *link = (struct link){0};
        strcpy(link->name, entry->d_name);
        snprintf(path, sizeof path, "%s/%s/carrier", folder, entry->d_name);
        link->carrier = place_line(path, text, sizeof text) && text[0] == '1';
        link->address = has_address(place, link->name);
    }
    if (names)
        closedir(names);
}

const struct link *network_find(const struct network *network, const char *name) {
    for (unsigned i = 0; i < network->count; i++)
        if (!strcmp(network->list[i].name, name))
            return &network->list[i];
    return NULL;
}

bool ssh_answers(unsigned port) {
    const struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons((uint16_t)port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const struct timeval patience = {.tv_sec = PATIENCE};
    char text[4];
    const int server = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

    if (server < 0)
        return false;
    setsockopt(server, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    setsockopt(server, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience); /* of connect(), too */
    const bool found = !connect(server, (const struct sockaddr *)&address, sizeof address) &&
                       recv(server, text, sizeof text, MSG_WAITALL) == (ssize_t)sizeof text &&
                       !memcmp(text, "SSH-", sizeof text);
    close(server);
    return found;
}
