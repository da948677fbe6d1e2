/* SPDX-License-Identifier: GPL-2.0-or-later */
#include "signature.h"

#include <dirent.h>
#include <limits.h>
#include <sodium.h>
#include <stdio.h>
#include <string.h>

#include "place.h"

#define UNTRUSTED "untrusted comment: "
#define TRUSTED "trusted comment: "

struct line {
    const char *begin;
    size_t size;
};

/* Take the next line, without its end; the last one may lack it. */
static bool take(const char **at, const char *end, struct line *line) {
    if (*at == end)
        return false;
    const char *found = memchr(*at, '\n', (size_t)(end - *at));
    line->begin = *at;
    line->size = (size_t)((found ? found : end) - *at);
    *at = found ? found + 1 : end;
    return true;
}

static bool begins(const struct line *line, const char *word) {
    return line->size >= strlen(word) && !memcmp(line->begin, word, strlen(word));
}

static bool decode(const struct line *line, uint8_t *bytes, size_t size) {
    size_t found;

    return !sodium_base642bin(bytes, size, line->begin, line->size, NULL, &found, NULL,
                              sodium_base64_VARIANT_ORIGINAL) &&
           found == size;
}

bool key_parse(const char *text, size_t size, struct update_key *key) {
    const char *at = text, *const end = text + size;
    struct line line;
    uint8_t bytes[2 + sizeof *key];

    if (!take(&at, end, &line) || !begins(&line, UNTRUSTED) || !take(&at, end, &line) ||
        !decode(&line, bytes, sizeof bytes) || memcmp(bytes, "Ed", 2) != 0 || at != end)
        return false;
    memcpy(key->id, bytes + 2, sizeof key->id);
    memcpy(key->key, bytes + 2 + sizeof key->id, sizeof key->key);
    return true;
}

const char *signature_parse(const char *text, size_t size, struct signature *signature) {
    const char *at = text, *const end = text + size;
    struct line line;
    uint8_t bytes[2 + KEY_ID + sizeof signature->value];

    if (!take(&at, end, &line) || !begins(&line, UNTRUSTED) || !take(&at, end, &line) ||
        !decode(&line, bytes, sizeof bytes))
        return "is not one of minisign's";
    if (!memcmp(bytes, "Ed", 2))
        return "has the legacy form; sign with minisign 0.10 or later, without -l";
    if (memcmp(bytes, "ED", 2) != 0)
        return "is not one of minisign's";
    memcpy(signature->id, bytes + 2, KEY_ID);
    memcpy(signature->value, bytes + 2 + KEY_ID, sizeof signature->value);
    if (!take(&at, end, &line) || !begins(&line, TRUSTED))
        return "has no trusted comment";
    signature->comment = line.begin + strlen(TRUSTED);
    signature->comment_size = line.size - strlen(TRUSTED);
    if (!take(&at, end, &line) || !decode(&line, signature->over_all, sizeof signature->over_all) || at != end)
        return "is not one of minisign's";
    return NULL;
}

bool signature_fits(const struct signature *signature, const struct update_key *key, const void *message, size_t size) {
    uint8_t hash[64], signed_too[sizeof signature->value + SIGNATURE_MAX];

    if (memcmp(signature->id, key->id, KEY_ID) != 0 || signature->comment_size > SIGNATURE_MAX)
        return false;
    crypto_generichash(hash, sizeof hash, message, size, NULL, 0);
    memcpy(signed_too, signature->value, sizeof signature->value);
    memcpy(signed_too + sizeof signature->value, signature->comment, signature->comment_size);
    return !crypto_sign_verify_detached(signature->value, hash, sizeof hash, key->key) &&
           !crypto_sign_verify_detached(signature->over_all, signed_too,
                                        sizeof signature->value + signature->comment_size, key->key);
}

unsigned keys_read(const char *folder, struct update_key keys[KEYS_MAX]) {
    DIR *names = opendir(folder);
    unsigned count = 0;

    for (const struct dirent *entry; names && count < KEYS_MAX && (entry = readdir(names));) {
        char path[PATH_MAX + NAME_MAX], text[KEY_FILE_MAX];
        if (entry->d_name[0] == '.')
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        FILE *file = fopen(path, "re");
        const size_t size = file ? fread(text, 1, sizeof text, file) : 0;
        if (key_parse(text, size, &keys[count]))
            count++;
        else
            fail(0, "%s: no key of minisign's; it is left out", path);
        if (file)
            fclose(file);
    }
    if (names)
        closedir(names);
    return count;
}
