/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "order.h"

#include <ctype.h>
#include <stdbool.h>
#include <string.h>

#define CTL "/usr/bin/ddxctl"
#define KIB 1024u
#define MIB (1024u * KIB)
#define HOUR 3600u /* s */

static const struct order orders[] = {
    {"health", {CTL, "health", "--json"}, 60, 64 * KIB, false},
    {"services", {CTL, "services", "--json"}, 30, 64 * KIB, false},
    {"items", {CTL, "list", "--json"}, 30, 256 * KIB, false},
    {"logs SERVICE", {CTL, "logs"}, 30, 256 * KIB, false},
    {"report", {CTL, "report"}, 120, 16 * MIB, false},
    {"enable SERVICE", {CTL, "enable"}, 60, 64 * KIB, true},
    {"disable SERVICE", {CTL, "disable"}, 60, 64 * KIB, true},
    {"start SERVICE", {CTL, "start"}, 60, 64 * KIB, true},
    {"stop SERVICE", {CTL, "stop"}, 60, 64 * KIB, true},
    {"restart SERVICE", {CTL, "restart"}, 60, 64 * KIB, true},
    {"record start", {CTL, "record", "start"}, 30, 4 * KIB, true},
    {"record stop", {CTL, "record", "stop"}, 30, 4 * KIB, true},
    {"record split", {CTL, "record", "split"}, 30, 4 * KIB, true},
    {"recordings", {CTL, "recordings", "list", "--json"}, 60, 4 * MIB, false},
    {"recordings verify RECORDING", {CTL, "recordings", "verify", "-progress"}, 6 * HOUR, 64 * KIB, false},
    {"recordings copy RECORDING STICK", {CTL, "recordings", "export", "-progress"}, 6 * HOUR, 64 * KIB, true},
    {"recordings remove RECORDING", {CTL, "recordings", "remove"}, 60, 64 * KIB, true},
    {"machine restart", {"/sbin/reboot"}, 10, 4 * KIB, true},
    {"machine off", {"/sbin/poweroff"}, 10, 4 * KIB, true},
};

/* NAME or NAME.INSTANCE, of letters, digits, - and _; not an option. */
static bool is_service(const char *word) {
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";
    size_t name = strspn(word, letters);

    if (!name || *word == '-' || strlen(word) > 63)
        return false;
    return !word[name] || (word[name] == '.' && word[name + 1] && !word[name + 1 + strspn(word + name + 1, letters)]);
}

/* ITEM-000012 or the name of a file in the recorder's folder; neither an option nor a path, nor a word for several. */
static bool is_recording(const char *word) {
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.:-";

    return *word && *word != '-' && *word != '.' && strlen(word) <= 255 && !word[strspn(word, letters)] &&
           strcmp(word, "all") != 0 && strcmp(word, "newest") != 0;
}

/* A visitor cannot choose where recordings are written. */
static bool is_stick(const char *word) {
    return !strcmp(word, "usb");
}

/* Words of a form that the visitor chooses. */
static const struct {
    const char *name;
    bool (*good)(const char *word);
    const char *reason;
} kinds[] = {{"SERVICE", is_service, "is not the name of a service"},
             {"RECORDING", is_recording, "is not the name of a recording"},
             {"STICK", is_stick, "is not usb"}};

static size_t find_kind(const char *word, size_t length) {
    size_t kind = 0;

    while (kind < sizeof kinds / sizeof kinds[0] &&
           (strlen(kinds[kind].name) != length || strncmp(kinds[kind].name, word, length) != 0))
        kind++;
    return kind;
}

/* Whether the words fit the form; if so and a word of the visitor's is refused, *reason is set. Writes the visitor's
 * words behind those of the command. */
static bool fits(const struct order *order, const char *const *words, const char **command, const char **reason) {
    *reason = NULL;
    for (const char *form = order->form; *form; words++) {
        size_t length = strcspn(form, " "), kind = find_kind(form, length);

        if (!*words)
            return false;
        if (kind == sizeof kinds / sizeof kinds[0]) {
            if (strlen(*words) != length || strncmp(*words, form, length) != 0)
                return false;
        } else if (kinds[kind].good(*words)) {
            *command++ = *words;
        } else {
            *reason = kinds[kind].reason;
        }
        form += length;
        form += strspn(form, " ");
    }
    *command = NULL;
    return !*words;
}

const struct order *order_find(const char *const *words, const char *command[ORDER_WORDS], const char **reason) {
    for (size_t i = 0; i < sizeof orders / sizeof orders[0]; i++) {
        unsigned fixed = 0;

        while (orders[i].command[fixed]) {
            command[fixed] = orders[i].command[fixed];
            fixed++;
        }
        if (fits(&orders[i], words, command + fixed, reason))
            return *reason ? NULL : &orders[i];
    }
    *reason = "there is no such order";
    return NULL;
}
