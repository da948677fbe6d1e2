/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "sight.h"

#include <arpa/inet.h>
#include <ddx.h>
#include <ddx_stats.h>
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "state.h"

#define FULL "make room and start again" /* a recorder's and a logger's last words on a full disk */
enum { TAIL = 1024 /* bytes of a log: a few starts, each of which fails */ };

static void take(const char *word, struct service *service) {
    const char *enabled = line_value(word, "enabled"), *state = line_value(word, "state");

    if (enabled)
        service->enabled = !strcmp(enabled, "yes");
    if (state) {
        service->runs = !strcmp(state, "running");
        service->misconfigured = !strcmp(state, "misconfigured");
    }
}

void services_read(const struct place *place, struct services *services) {
    char path[PATH_MAX], line[256], *rest = NULL;

    services->count = 0;
    place_path(place, "/run/update.services", path);
    FILE *file = fopen(path, "re");
    while (file && services->count < SERVICES_MAX && fgets(line, sizeof line, file)) {
        const char *name = strtok_r(line, " \n", &rest);
        if (!name || strlen(name) >= WORD_MAX || strchr(name, '/'))
            continue;
        struct service *service = &services->list[services->count++];
        *service = (struct service){0};
        strcpy(service->name, name);
        for (const char *word; (word = strtok_r(NULL, " \n", &rest));)
            take(word, service);
        /* A service with a wrong line counts as disabled there. */
        service->enabled |= service->misconfigured;
    }
    if (file)
        fclose(file);
}

static bool there(const char *folder, const char *name) {
    char path[PATH_MAX + WORD_MAX];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    return !access(path, F_OK);
}

static void line_of(const char *folder, const char *name, char text[WORD_MAX]) {
    char path[PATH_MAX + WORD_MAX];

    snprintf(path, sizeof path, "%s/%s", folder, name);
    place_line(path, text, WORD_MAX);
}

/* The folder belongs to the log's user, so no link is followed. */
static bool log_ends_with(const struct place *place, const char *name, const char *words) {
    char path[PATH_MAX], log[2 * WORD_MAX], text[TAIL];

    snprintf(log, sizeof log, "/run/log/%s/current", name);
    place_path(place, log, path);
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0)
        return false;
    const off_t size = lseek(fd, 0, SEEK_END);
    const ssize_t got = pread(fd, text, sizeof text, size > TAIL ? size - TAIL : 0);
    close(fd);
    return got > 0 && memmem(text, (size_t)got, words, strlen(words));
}

/* Bring it up to date with the folders of runsvdir. */
static void services_look(const struct place *place, struct services *services) {
    char folder[PATH_MAX], name[2 * WORD_MAX], text[WORD_MAX];

    for (unsigned i = 0; i < services->count; i++) {
        struct service *service = &services->list[i];
        snprintf(name, sizeof name, "/run/service/%s", service->name);
        place_path(place, name, folder);
        service->runs = false;
        if (!there(folder, "run"))
            continue;
        service->stopped = there(folder, "down");
        service->misconfigured = there(folder, "misconfigured") && !service->stopped;
        line_of(folder, "supervise/stat", text);
        service->runs = (!strncmp(text, "run", 3) && !there(folder, "waiting")) || there(folder, "complete");
        service->full = log_ends_with(place, service->name, FULL);
        line_of(folder, "restarts", text);
        service->restarts = (unsigned)strtoul(text, NULL, 10);
    }
}

#define SUFFIX ".stats"
#define TYPE "DDX_STATS"

static bool is_of(const char *instance, const char *program) {
    const size_t length = strlen(program);

    return !strncmp(instance, program, length) && (!instance[length] || instance[length] == '.');
}

/* The item's instance, if it is one of those. */
static bool is_counter(const struct ddx_item_info *item, struct counter *counter) {
    const size_t length = strlen(item->name), suffix = strlen(SUFFIX);

    if (length <= suffix || length - suffix >= WORD_MAX || strcmp(item->name + length - suffix, SUFFIX) != 0 ||
        strcmp(item->type, TYPE) != 0)
        return false;
    *counter = (struct counter){0};
    memcpy(counter->name, item->name, length - suffix);
    counter->kind = is_of(counter->name, "ddxvideosave") ? RECORDER : is_of(counter->name, "ddxlog") ? LOGGER : GRABBER;
    return counter->kind != GRABBER || is_of(counter->name, "ddxvideoV4L") || is_of(counter->name, "ddxvideo1394");
}

static bool read_counter(DDX_STORE_ID *id, const char *name, struct counter *counter) {
    DDX_STATS stats;
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, name, NULL, 0);
    const bool found =
        item && !strcmp(ddx_store_item_type(item), TYPE) && !ddx_store_read(item, &stats, NULL, 0, DDX_CURRENT);

    if (item)
        ddx_store_done_item(item);
    if (!found)
        return false;
    counter->taken = stats.in;
    counter->passed = counter->kind == GRABBER ? stats.in : stats.out;
    counter->waiting = stats.waiting;
    for (unsigned i = 0; i < DDX_STATS_REASONS && i < stats.reasons; i++)
        counter->lost += stats.lost[i].frames;
    return true;
}

void frames_look(struct frames *frames) {
    struct ddx_item_info *items = NULL;
    unsigned count = 0;
    DDX_STORE_ID *id = ddx_store_open(NULL, 0, 0);

    *frames = (struct frames){.answered = id && !ddx_store_list(id, NULL, &items, &count)};
    for (unsigned i = 0; i < count && frames->count < COUNTERS_MAX; i++)
        if (is_counter(&items[i], &frames->list[frames->count]) &&
            read_counter(id, items[i].name, &frames->list[frames->count]))
            frames->count++;
    free(items);
    ddx_store_close(id);
}

const struct counter *frames_find(const struct frames *frames, const char *name) {
    for (unsigned i = 0; i < frames->count; i++)
        if (!strcmp(frames->list[i].name, name))
            return &frames->list[i];
    return NULL;
}

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

/* All interfaces but the loopback and the kernel's own tunnels. */
static void network_look(const struct place *place, struct network *network) {
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

#define CHECKING "is being checked"

/* The last line of the log of recordings-disk is its state. */
static bool is_checking(const struct place *place) {
    char path[PATH_MAX], line[512] = "";

    place_path(place, "/run/log/recordings-disk", path);
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file))
        continue;
    if (file)
        fclose(file);
    return strstr(line, CHECKING) != NULL;
}

void sight_look(const struct place *place, struct sight *sight) {
    char path[PATH_MAX], text[WORD_MAX];

    frames_look(&sight->frames);
    services_look(place, &sight->services);
    network_look(place, &sight->network);
    place_path(place, "/sys/class/watchdog/watchdog0/state", path);
    sight->watchdog = place_line(path, text, sizeof text) && !strcmp(text, "active");
    sight->checking = is_checking(place);
}

static void add(char words[WORDS_MAX], const char *name) {
    const size_t length = strlen(words);

    if (length + strlen(name) + 2 <= WORDS_MAX)
        snprintf(words + length, WORDS_MAX - length, "%s%s", length ? " " : "", name);
}

static bool flows(const struct frames *before, const struct counter *now) {
    const struct counter *was = frames_find(before, now->name);

    return was && now->passed > was->passed;
}

void former_make(struct former *former, const struct sight *before, const struct sight *now) {
    *former = (struct former){.known = true, .ssh = now->ssh, .watchdog = now->watchdog};
    for (unsigned i = 0; i < now->services.count; i++)
        if (now->services.list[i].runs)
            add(former->runs, now->services.list[i].name);
    for (unsigned i = 0; i < now->frames.count; i++)
        if (now->frames.list[i].kind != LOGGER && flows(&before->frames, &now->frames.list[i]))
            add(former->flows, now->frames.list[i].name);
    for (unsigned i = 0; i < now->network.count; i++) {
        add(former->links, now->network.list[i].name);
        if (now->network.list[i].address)
            add(former->addresses, now->network.list[i].name);
    }
}

void former_read(struct former *former, const struct place *place, const char *version) {
    char value[WORDS_MAX];
    const char here[] = {place->here, 0};

    *former = (struct former){0};
    if (!state_is(place->state, "tried", here))
        return;
    state_get(place->state, "version", value, sizeof value);
    if (strcmp(value, version) != 0)
        return;
    former->known = true;
    state_get(place->state, "runs", former->runs, WORDS_MAX);
    state_get(place->state, "flows", former->flows, WORDS_MAX);
    state_get(place->state, "links", former->links, WORDS_MAX);
    state_get(place->state, "addresses", former->addresses, WORDS_MAX);
    former->ssh = state_is(place->state, "ssh", "yes");
    former->watchdog = state_is(place->state, "watchdog", "yes");
}

bool former_has(const char *words, const char *name) {
    const size_t length = strlen(name);

    for (const char *at = words; (at = strstr(at, name)); at += length)
        if ((at == words || at[-1] == ' ') && (!at[length] || at[length] == ' '))
            return true;
    return false;
}
