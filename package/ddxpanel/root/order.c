/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "order.h"

#include <ctype.h>
#include <stdbool.h>
#include <string.h>

#define CTL "/usr/bin/ddxctl"
#define JOB "/usr/libexec/ddx/panel-job"
#define RESET "/usr/libexec/ddx/panel-reset"
#define KIB 1024u
#define MIB (1024u * KIB)
#define HOUR 3600u /* s */
#define ANY UINT64_MAX

static const struct order orders[] = {
    {"health", {CTL, "health", "--json"}, 60, 64 * KIB, ORDER_SHOWS},
    {"services", {CTL, "services", "--json"}, 30, 64 * KIB, ORDER_SHOWS},
    {"items", {CTL, "list", "--json"}, 30, 256 * KIB, ORDER_SHOWS},
    {"logs SERVICE", {CTL, "logs"}, 30, 256 * KIB, ORDER_SHOWS},
    {"report", {CTL, "report"}, 120, 16 * MIB, ORDER_SHOWS},
    {"enable SERVICE", {CTL, "enable"}, 60, 64 * KIB, ORDER_CHANGES},
    {"disable SERVICE", {CTL, "disable"}, 60, 64 * KIB, ORDER_CHANGES},
    {"start SERVICE", {CTL, "start"}, 60, 64 * KIB, ORDER_CHANGES},
    {"stop SERVICE", {CTL, "stop"}, 60, 64 * KIB, ORDER_CHANGES},
    {"restart SERVICE", {CTL, "restart"}, 60, 64 * KIB, ORDER_CHANGES},
    {"record start", {CTL, "record", "start"}, 30, 4 * KIB, ORDER_CHANGES},
    {"record stop", {CTL, "record", "stop"}, 30, 4 * KIB, ORDER_CHANGES},
    {"record split", {CTL, "record", "split"}, 30, 4 * KIB, ORDER_CHANGES},
    {"recordings", {CTL, "recordings", "list", "--json"}, 60, 4 * MIB, ORDER_SHOWS},
    {"recordings verify", {JOB, "begin", "verify"}, 30, 4 * KIB, ORDER_CHANGES},
    {"recordings verify RECORDING", {JOB, "begin", "verify"}, 30, 4 * KIB, ORDER_CHANGES},
    {"recordings copy all STICK", {JOB, "begin", "export", "all"}, 30, 4 * KIB, ORDER_CHANGES},
    {"recordings copy RECORDING STICK", {JOB, "begin", "export"}, 30, 4 * KIB, ORDER_CHANGES},
    {"job", {JOB, "show"}, 30, 64 * KIB, ORDER_SHOWS},
    {"job stop", {JOB, "stop"}, 30, 4 * KIB, ORDER_CHANGES},
    {"recordings read FILE NUMBER", {CTL, "recordings", "read", "-size"}, 24 * HOUR, ANY, ORDER_BYTES},
    {"recordings remove RECORDING", {CTL, "recordings", "remove"}, 60, 64 * KIB, ORDER_CHANGES},
    {"stream SERVICE", {CTL, "stream"}, 30, 16 * KIB, ORDER_SHOWS},
    {"add SENDER SETTINGS", {CTL, "add"}, 60, 64 * KIB, ORDER_CHANGES},
    {"remove SENDER", {CTL, "remove"}, 60, 64 * KIB, ORDER_CHANGES},
    {"reset settings", {RESET}, 300, 64 * KIB, ORDER_CHANGES},
    {"machine restart", {"/sbin/reboot"}, 10, 4 * KIB, ORDER_CHANGES},
    {"machine off", {"/sbin/poweroff"}, 10, 4 * KIB, ORDER_CHANGES},
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

static bool is_number(const char *word) {
    return *word && strlen(word) <= 18 && !word[strspn(word, "0123456789")];
}

/* An instance of the sender, not the image's own one. */
static bool is_sender(const char *word) {
    static const char program[] = "ddxvideosend.";

    return is_service(word) && !strncmp(word, program, strlen(program));
}

/* Settings of a stream's content and destination; not those of files and of the program's priority. */
static bool is_setting(const char *word) {
    static const char *const keys[] = {"name", "group", "to", "port", "ts", "wire"};
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.:,[]-";
    size_t length = strcspn(word, "="), key = 0;
    const char *value = word + length + (word[length] == '=');

    while (key < sizeof keys / sizeof keys[0] && (strlen(keys[key]) != length || strncmp(keys[key], word, length) != 0))
        key++;
    return key < sizeof keys / sizeof keys[0] && *value && *value != '-' && strlen(value) <= 127 &&
           !value[strspn(value, letters)];
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
    unsigned most; /* such words that may follow each other, as the last ones of the form */
} kinds[] = {{"SERVICE", is_service, "is not the name of a service", 1},
             {"RECORDING", is_recording, "is not the name of a recording", 1},
             {"FILE", is_recording, "is not the name of a recording's file", 1},
             {"NUMBER", is_number, "is not a number", 1},
             {"SENDER", is_sender, "is not an added stream, ddxvideosend.NAME", 1},
             {"SETTINGS", is_setting, "is not a setting of a stream", 6},
             {"STICK", is_stick, "is not usb", 1}};

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
    for (const char *form = order->form; *form;) {
        size_t length = strcspn(form, " "), kind = find_kind(form, length);

        if (!*words)
            return false;
        if (kind == sizeof kinds / sizeof kinds[0]) {
            if (strlen(*words) != length || strncmp(*words, form, length) != 0)
                return false;
            words++;
        } else {
            for (unsigned count = 0; *words && count < kinds[kind].most; count++, words++)
                if (kinds[kind].good(*words))
                    *command++ = *words;
                else
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
