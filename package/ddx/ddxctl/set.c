/* SPDX-License-Identifier: GPL-2.0-or-later */
/* Change an item: by a request to its program, or by writing its newest value again with some fields changed. */
#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ddx_request.h"
#include "ddxctl.h"

/* ---- Change of a field ---- */

/* "wheel[2].speed=1.5": finds the field in the item's layout, and parses the value according to the field's kind. */

/* The left side of the "=": a field, or one element of it. */
struct place {
    const struct ddx_field *field;
    uint64_t offset, count; /* elements that the value may set */
};

static char problem[1024];
static char asked[2 * DDX_NAME_MAX]; /* the path as typed */

static const char *wrong(const char *format, ...) __attribute__((format(printf, 1, 2)));
static const char *wrong(const char *format, ...) {
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(problem, sizeof problem, format, arguments);
    va_end(arguments);
    return problem;
}

/* Parse an index such as "[3]" at *at, if there is one. NULL, or the error text. */
static const char *index_at(const char **at, const struct ddx_field *field, bool *there, uint64_t *index) {
    uint64_t count = field->used / field->bytes;
    char *end;

    *there = **at == '[';
    *index = 0;
    if (!*there)
        return NULL;
    const char *digits = *at + 1;
    errno = 0;
    *index = strtoull(digits, &end, 10);
    if (*digits < '0' || *digits > '9' || *end != ']')
        return wrong("%s: an index is a number in brackets", field->name);
    if (errno || *index >= count)
        return wrong("%s: its elements are 0 to %llu", field->name, (unsigned long long)count - 1);
    *at = end + 1;
    return NULL;
}

/* Error text with the names of the outermost fields. */
static const char *no_such_field(const DDX_STORE_ITEM *item, int length, const char *path) {
    const struct ddx_field *field;
    const char *text = wrong("%.*s: no such field; there are", length, path);

    for (unsigned i = 0; (field = ddx_store_field(item, i)); i += 1 + field->children) {
        size_t used = strlen(problem);

        snprintf(problem + used, sizeof problem - used, "%s %s", i ? "," : "", *field->name ? field->name : "value");
    }
    return text;
}

/* Follow the path "a[1].b.c[2]" field by field; `end` is the byte after it. */
static const char *find_place(const DDX_STORE_ITEM *item, const char *path, const char *end, struct place *place) {
    char name[DDX_NAME_MAX + 1] = "";
    const char *at = path;
    uint64_t inside = 0, index;

    for (;;) {
        size_t length = strcspn(at, ".[="), before = strlen(name);
        bool there;

        if (before + length + 2 > sizeof name)
            return no_such_field(item, (int)(end - path), path);
        snprintf(name + before, sizeof name - before, "%s%.*s", before ? "." : "", (int)length, at);
        at += length;
        place->field = ddx_store_field_named(item, name);
        if (!place->field)
            return no_such_field(item, (int)(at - path), path);
        if (!place->field->used)
            return wrong("%s: no byte of it is in use", name);
        const char *bad = index_at(&at, place->field, &there, &index);
        if (bad)
            return bad;
        place->offset = place->field->offset + inside + index * place->field->bytes;
        place->count = there ? 1 : place->field->used / place->field->bytes;
        inside += index * place->field->bytes;
        bool nested = place->field->kind == DDX_KIND_STRUCT;
        if (nested && place->count > 1)
            return wrong("%s: an array of structs: %s[0]...", name, name);
        if (nested && at == end)
            return wrong("%s: a struct; name a field in it", name);
        if (at == end)
            return NULL;
        if (!nested || *at != '.')
            return no_such_field(item, (int)(end - path), path);
        at++;
    }
}

/* Integers of any width are stored as their low bytes: the machines of this library are little-endian. */
static const char *put_integer(const struct ddx_field *field, void *to, const char *text, const char **end) {
    const char *digits = text + strspn(text, " ");
    bool negative = *digits == '-';
    unsigned bits = 8 * field->bytes;
    bool sign = field->kind != DDX_KIND_UNSIGNED;
    uint64_t most = field->kind == DDX_KIND_INT ? UINT64_MAX >> (65 - bits) : UINT64_MAX >> (64 - bits);
    uint64_t least = sign ? (uint64_t)1 << (bits - 1) : 0; /* below zero */
    char *stop;

    digits += negative || *digits == '+';
    bool hexadecimal = *digits == '0' && (digits[1] | 32) == 'x'; /* no octal: 010 is ten */
    errno = 0;
    uint64_t value = strtoull(digits, &stop, hexadecimal ? 16 : 10);
    if (negative)
        value = 0 - value; /* modulo 2^64 */
    bool fits = !errno && (negative ? 0 - value <= least : value <= most);
    if (*digits < '0' || *digits > '9' || !fits || (*stop && *stop != ','))
        return wrong("%s: takes a whole number from %s%llu to %llu, not %s", asked, sign ? "-" : "",
                     (unsigned long long)least, (unsigned long long)most, text);
    *end = stop;
    if (to)
        memcpy(to, &value, field->bytes);
    return NULL;
}

static const char *put_real(const struct ddx_field *field, void *to, const char *text, const char **end) {
    double most = field->bytes == 4 ? (double)FLT_MAX : DBL_MAX;
    char *stop;
    double value = strtod(text, &stop);

    if (stop == text || !(fabs(value) <= most) || (*stop && *stop != ','))
        return wrong("%s: takes a number from %g to %g, not %s", asked, -most, most, text);
    *end = stop;
    float single = (float)value;
    if (to)
        memcpy(to, field->bytes == 4 ? (void *)&single : (void *)&value, field->bytes);
    return NULL;
}

static const char *put_text(const struct place *place, char *to, const char *text) {
    size_t length = strlen(text);

    if (length >= place->count)
        return wrong("%s: takes a text of 0 to %llu bytes, not %zu", asked, (unsigned long long)place->count - 1,
                     length);
    if (to) {
        memset(to, 0, (size_t)place->count);
        memcpy(to, text, length);
    }
    return NULL;
}

static const char *put_numbers(const struct place *place, char *to, const char *text) {
    const struct ddx_field *field = place->field;
    uint64_t i = 0;

    for (const char *at = text;; at++) {
        const char *bad = i >= place->count ? "more"
                          : field->kind == DDX_KIND_FLOAT
                              ? put_real(field, to ? to + i * field->bytes : NULL, at, &at)
                              : put_integer(field, to ? to + i * field->bytes : NULL, at, &at);

        if (bad && i < place->count)
            return bad;
        i++;
        if (bad || !*at)
            break;
    }
    if (i == place->count)
        return NULL;
    return wrong("%s: takes %llu numbers, or name one of them: %s[0]", asked, (unsigned long long)place->count, asked);
}

/*
 * Apply "field=value" to a value of the item's type; `apply` false: only check it. NULL, or the error text, in static
 * memory.
 */
static const char *change_field(const DDX_STORE_ITEM *item, void *data, const char *change, bool apply) {
    const char *end = strchr(change, '=');
    const char *path = change;
    struct place place = {0};

    if (!end)
        return wrong("%s: not field=value", change);
    if (!ddx_store_field(item, 0))
        return wrong("a type that only its programs know");
    if (!*ddx_store_field(item, 0)->name && !strncmp(change, "value=", 6))
        path = end; /* not a struct: the only field has no name */
    snprintf(asked, sizeof asked, "%.*s", (int)(end - change), change);
    const char *bad = find_place(item, path, end, &place);
    if (bad)
        return bad;
    char *to = apply ? (char *)data + place.offset : NULL;
    return place.field->kind == DDX_KIND_CHAR && place.count > 1 ? put_text(&place, to, end + 1)
                                                                 : put_numbers(&place, to, end + 1);
}

/* ---- Requests ---- */

/* "brightness=128" for an item whose program takes requests. */

#define ANSWER_WAIT 3.0 /* s */

static bool parse(const char *word, char name[DDX_REQUEST_NAME], struct ddx_change *change) {
    const char *equals = strchr(word, '=');
    char *end;

    if (!equals || (size_t)(equals - word) >= DDX_REQUEST_NAME)
        return false;
    snprintf(name, DDX_REQUEST_NAME, "%.*s", (int)(equals - word), word);
    const char *digits = equals + 1 + (equals[1] == '-' || equals[1] == '+');
    bool hexadecimal = *digits == '0' && (digits[1] | 32) == 'x'; /* no octal: 010 is ten */
    errno = 0;
    change->name = name;
    change->value = strtoll(equals + 1, &end, hexadecimal ? 16 : 10);
    return !errno && *digits >= '0' && *digits <= '9' && !*end;
}

/* Ask the program that writes the item for the changes (ddx_request.h); the exit status. */
static int ask_for_changes(DDX_STORE_ID *id, const struct request *request) {
    char names[DDX_REQUEST_CHANGES][DDX_REQUEST_NAME], text[DDX_ANSWER_TEXT];
    struct ddx_change changes[DDX_REQUEST_CHANGES];

    for (unsigned i = 0; i < request->change_count && i < DDX_REQUEST_CHANGES; i++)
        if (!parse(request->changes[i], names[i], &changes[i])) {
            fprintf(stderr, "ddxctl: %s: %s: not name=number\n", request->item, request->changes[i]);
            return 2;
        }
    int error = ddx_request(id, request->item, changes, request->change_count, ANSWER_WAIT, text);
    if (error)
        fprintf(stderr, "ddxctl: %s: %s\n", request->item, text);
    if (!error)
        return 0;
    return error == -EINVAL || error == -ERANGE || error == -EACCES ? 2 : 1;
}

/* ---- set ---- */

static const char *change_all(const DDX_STORE_ITEM *item, void *data, const struct request *request, bool apply) {
    const char *bad = NULL;

    for (unsigned i = 0; i < request->change_count && !bad; i++)
        bad = change_field(item, data, request->changes[i], apply);
    return bad;
}

static int refuse(const struct request *request, const char *bad) {
    fprintf(stderr, "ddxctl: %s: %s\n", request->item, bad);
    return 2;
}

/* Copy, or clear, only the bytes in use: neither frame nor loan has memory beyond a field's extent. */
static void copy(const DDX_STORE_ITEM *item, char *to, const char *from) {
    const struct ddx_field *field;

    for (unsigned i = 0; (field = ddx_store_field(item, i)); i += 1 + field->children) {
        if (from)
            memcpy(to + field->offset, from + field->offset, (size_t)field->used);
        else
            memset(to + field->offset, 0, (size_t)field->used);
    }
}

/*
 * While this handle is the writer, no other program can write between the read of the value and the write of the next
 * one.
 */
static int write_changed(DDX_STORE_ITEM *item, const struct request *request) {
    struct ddx_frame frame;
    void *data;
    int result = ddx_store_loan(item, &data);

    if (result == -EEXIST) {
        struct ddx_item_info info = {.writer_pid = 0};

        ddx_store_item_info(item, &info);
        fprintf(stderr, "ddxctl: %s: not set, process %d writes it; stop it first\n", request->item,
                (int)info.writer_pid);
        return 1;
    }
    if (result)
        return complain(request->item, result);
    result = ddx_store_acquire(item, &frame, 0, DDX_CURRENT);
    if (result && result != -ETIMEDOUT) {
        ddx_store_cancel(item);
        return complain(request->item, result);
    }
    copy(item, data, result ? NULL : frame.data); /* an item that was never written begins with zeros */
    if (!result)
        ddx_store_release(item);
    const char *bad = change_all(item, data, request, true);
    if (bad) { /* a writer has changed the layout since the check */
        ddx_store_cancel(item);
        return refuse(request, bad);
    }
    result = ddx_store_publish(item, NULL);
    return result ? complain(request->item, result) : 0;
}

int command_set(DDX_STORE_ID *id, const struct request *request) {
    int asks = ddx_request_possible(id, request->item);
    if (asks < 0)
        return complain(request->item, asks);
    if (asks)
        return ask_for_changes(id, request);
    DDX_STORE_ITEM *item = ddx_store_lookup_item(id, request->item, NULL, 0);

    if (!item)
        return complain(request->item, errno);
    /* All changes are checked before the handle becomes the writer. */
    const char *bad = change_all(item, NULL, request, false);
    int status = bad ? refuse(request, bad) : write_changed(item, request);
    ddx_store_done_item(item);
    return status;
}

/* ---- record ---- */

/* Commands to a recorder, sent as requests to its instance. */

#define RECORDER "ddxvideosave"
#define RECORD_WAIT 5.0 /* s: the recorder may wait for its disk */

#define WORDS "start, stop, split or pre-roll SECONDS is needed, and then at most an instance"

static int bad_usage(const char *word) {
    fprintf(stderr, "ddxctl: record: %s: " WORDS "\n", word);
    return 2;
}

int command_record(DDX_STORE_ID *id, const struct request *request) {
    static const struct {
        const char *word;
        struct ddx_change change;
    } commands[] = {{"start", {"recording", 1}}, {"stop", {"recording", 0}}, {"split", {"split", 1}}};
    char text[DDX_ANSWER_TEXT], *end;
    unsigned used = 0; /* words after the first one */
    struct ddx_change change = {"pre_roll", 0};
    size_t i = 0, count = sizeof commands / sizeof commands[0];

    while (i < count && strcmp(commands[i].word, request->item) != 0)
        i++;
    if (i < count) {
        change = commands[i].change;
    } else if (!strcmp(request->item, "pre-roll") && request->change_count) {
        change.value = strtoll(request->changes[used++], &end, 10);
        if (*request->changes[0] < '0' || *request->changes[0] > '9' || *end)
            return bad_usage(request->changes[0]);
    } else
        return bad_usage(request->item);
    if (request->change_count > used + 1)
        return bad_usage(request->changes[used + 1]);
    const char *recorder = request->change_count > used ? request->changes[used] : RECORDER;
    int error = ddx_request(id, recorder, &change, 1, RECORD_WAIT, text);
    if (error == -EOPNOTSUPP)
        fprintf(stderr, "ddxctl: record: no recorder %s is running\n", recorder);
    else if (error)
        fprintf(stderr, "ddxctl: record: %s: %s\n", recorder, text);
    if (!error)
        return 0;
    return error == -EINVAL || error == -ERANGE || error == -EACCES ? 2 : 1;
}
